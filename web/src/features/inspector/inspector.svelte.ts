/** What the inspector shows. Its telemetry socket is open, and values are read, only while the panel is open. */

import type { ApiClient } from '../../api/client';
import { TelemetrySocket } from '../../live/socket';
import type { Frame } from '../../live/wire';
import { LiveView } from '../../plots/live-view.svelte';
import type { Received } from './messages';

const TOPIC = 'mavlink_messages';
const RATE_HZ = 2;
/** Time that the plot shows [s]. */
const SHOWN_S = 30;

export class Inspector {
  search = $state('');
  /** Key of the message whose fields are shown; null: none. */
  expanded = $state<string | null>(null);
  content = $state.raw<Received | null>(null);
  /** Time at which `content` was received, by `performance.now()`. */
  received_ms = $state(0);
  /** The plotted numbers, in one pane. */
  readonly plots: LiveView;

  constructor(api: ApiClient) {
    this.plots = new LiveView(api);
    this.plots.length_s = SHOWN_S;
  }

  /** The plotted numbers, as fields of a telemetry log. */
  get fields(): readonly string[] {
    return this.plots.panes[0]?.fields ?? [];
  }

  /** Receives the messages of a vehicle until the returned function is called. @param start starts the socket; replaced in tests. */
  watch(vehicle: string, name: string, url: string, start = (socket: TelemetrySocket): void => socket.start()): () => void {
    [this.content, this.expanded] = [null, null];
    this.plots.open(vehicle, name);
    const subscription = { vehicles: [vehicle], topics: [TOPIC], rate_hz: RATE_HZ };
    const socket = new TelemetrySocket(
      url,
      () => subscription,
      (frame) => this.onFrame(frame, vehicle),
      () => undefined,
      () => true,
    );
    start(socket);
    const stop = this.plots.watch(() => null, false);
    return () => {
      socket.stop();
      stop();
      this.plots.close();
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
}
