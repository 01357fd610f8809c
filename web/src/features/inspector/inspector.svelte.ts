/** What the inspector shows. Its telemetry socket is open, and values are read, only while the panel is open. */

import type { ApiClient } from '../../api/client';
import { TelemetrySocket } from '../../live/socket';
import type { Frame } from '../../live/wire';
import { keyOfPlot, type Plotted, type Received } from './messages';

const TOPIC = 'mavlink_messages';
const RATE_HZ = 2;
const POLL_MS = 300;
export const MAX_PLOTTED = 4;
/** Time that a plot shows [s]. */
export const SHOWN_S = 30;

export interface Line {
  readonly plotted: Plotted;
  /** Arrivals, on the server's clock [s]. */
  readonly times_s: readonly number[];
  readonly values: readonly (number | null)[];
}

export class Inspector {
  search = $state('');
  /** Key of the message whose fields are shown; null: none. */
  expanded = $state<string | null>(null);
  content = $state.raw<Received | null>(null);
  /** Time at which `content` was received, by `performance.now()`. */
  received_ms = $state(0);
  lines = $state.raw<readonly Line[]>([]);
  /** Time of the newest answer, on the clock of the lines [s]. */
  now_s = $state(0);
  private reading = false;

  /** Receives the messages of a vehicle until the returned function is called. @param start starts the socket; replaced in tests. */
  watch(api: ApiClient, vehicle: string, url: string, start = (socket: TelemetrySocket): void => socket.start()): () => void {
    [this.content, this.expanded, this.lines] = [null, null, []];
    const subscription = { vehicles: [vehicle], topics: [TOPIC], rate_hz: RATE_HZ };
    const socket = new TelemetrySocket(
      url,
      () => subscription,
      (frame) => this.onFrame(frame, vehicle),
      () => undefined,
      () => true,
    );
    start(socket);
    const timer = setInterval(() => void this.read(api, vehicle), POLL_MS);
    return () => {
      socket.stop();
      clearInterval(timer);
      this.lines = [];
    };
  }

  onFrame(frame: Frame, vehicle: string): void {
    if (frame.type !== 'samples') return;
    for (const sample of frame.samples) {
      if (sample.topic !== TOPIC || sample.vehicle !== vehicle) continue;
      this.content = sample.value as Received;
      this.received_ms = performance.now();
    }
  }

  isPlotted(plotted: Plotted): boolean {
    return this.lines.some((line) => keyOfPlot(line.plotted) === keyOfPlot(plotted));
  }

  /** Adds a number to the plot, or removes it. */
  toggle(plotted: Plotted): void {
    if (this.isPlotted(plotted)) this.lines = this.lines.filter((line) => keyOfPlot(line.plotted) !== keyOfPlot(plotted));
    else if (this.lines.length < MAX_PLOTTED) this.lines = [...this.lines, { plotted, times_s: [], values: [] }];
  }

  /** Reads what has arrived of the plotted numbers; one request for each message. */
  async read(api: ApiClient, vehicle: string): Promise<void> {
    if (this.reading || this.lines.length === 0) return;
    this.reading = true;
    try {
      for (const line of this.lines) {
        const { message, component, field } = line.plotted;
        const query = { message, component, field: [field], after_s: line.times_s.at(-1) ?? 0 };
        const answer = await api.get('/vehicles/{v}/mavlink/series', { params: { path: { v: vehicle }, query } });
        if (!answer.ok) continue;
        const { now_s, times_s, values } = answer.value;
        this.now_s = now_s;
        this.add(line, times_s, values[field] ?? []);
      }
    } finally {
      this.reading = false;
    }
  }

  private add(to: Line, times_s: readonly number[], values: readonly (number | null)[]): void {
    this.lines = this.lines.map((line) => {
      if (line !== to) return line;
      const all_s = [...line.times_s, ...times_s];
      const first = Math.max(
        0,
        all_s.findIndex((t_s) => t_s >= this.now_s - SHOWN_S),
      );
      return { plotted: line.plotted, times_s: all_s.slice(first), values: [...line.values, ...values].slice(first) };
    });
  }
}
