/** State of the panel with the vehicle's console. The panel has a separate telemetry socket, open only while the panel is open. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import { CommandGate, DOUBLE_CLICK } from '../../app/actions/command.svelte';
import { TelemetrySocket } from '../../live/socket';
import type { Frame } from '../../live/wire';

const TOPIC = 'shell';
const RATE_HZ = 10;
const COMMAND = 'Console line';
const MAX_HISTORY = 100;
/** The server keeps as much, too. */
const MAX_CHARACTERS = 100_000;

export type ShellOutput = components['schemas']['ShellOutput'];

export class ShellPanelState {
  /** The vehicle whose output is shown. */
  private vehicle = '';
  text = $state('');
  private end = 0;
  /** Whether the output before `end` has been read. */
  private isRead = false;
  private lastProblem = $state.raw<{ readonly vehicle: string; readonly problem: Problem } | null>(null);
  private history: readonly string[] = [];
  /** Position in the history from its end; 0: the line that is being typed. */
  private back = 0;

  constructor(private readonly gate = new CommandGate()) {}

  /** Why the last line to this vehicle was not sent or had no answer; null: it had one. */
  problemOf(vehicle: string): Problem | null {
    return this.lastProblem?.vehicle === vehicle ? this.lastProblem.problem : null;
  }

  /** Whether the vehicle has not echoed the last line yet. */
  isSending(vehicle: string): boolean {
    return this.gate.isWaiting({ name: COMMAND, vehicles: [vehicle] });
  }

  /** Shows the output of a vehicle until the returned function is called. @param start starts the socket; replaced in tests. */
  watch(api: ApiClient, vehicle: string, url: string, start = (socket: TelemetrySocket): void => socket.start()): () => void {
    [this.vehicle, this.text, this.end, this.isRead, this.back] = [vehicle, '', 0, false, 0];
    void this.read(api);
    const subscription = { vehicles: [vehicle], topics: [TOPIC], rate_hz: RATE_HZ };
    const socket = new TelemetrySocket(
      url,
      () => subscription,
      (frame) => this.onFrame(api, frame),
      () => undefined,
      () => true,
    );
    start(socket);
    return () => socket.stop();
  }

  /** Reads the output that the page does not have. */
  private async read(api: ApiClient): Promise<void> {
    const vehicle = this.vehicle;
    const answer = await api.get('/vehicles/{v}/shell', { params: { path: { v: vehicle }, query: { after: this.end } } });
    if (vehicle !== this.vehicle || !answer.ok) return;
    this.isRead = true;
    if (this.add(answer.value)) return;
    [this.text, this.end] = ['', 0]; // the server does not have it any more either
    this.add(answer.value);
  }

  onFrame(api: ApiClient, frame: Frame): void {
    if (frame.type !== 'samples') return;
    for (const sample of frame.samples) {
      if (sample.topic !== TOPIC || sample.vehicle !== this.vehicle || !this.isRead) continue;
      if (!this.add(sample.value as ShellOutput)) void this.read(api);
    }
  }

  /** Adds what is new. @returns false: output between the two is missing. */
  private add(output: ShellOutput): boolean {
    if (output.end < this.end) [this.text, this.end] = ['', 0]; // another server, or the vehicle was found again
    const start = output.end - output.text.length;
    if (start > this.end && this.end > 0) return false;
    this.text = (this.text + output.text.slice(Math.max(0, this.end - start))).slice(-MAX_CHARACTERS);
    this.end = output.end;
    return true;
  }

  /** Sends a line. @returns whether the vehicle has echoed it. */
  async send(api: ApiClient, vehicle: string, line: string, whileArmed: boolean): Promise<boolean> {
    this.lastProblem = null;
    if (line !== '' && line !== this.history.at(-1)) this.history = [...this.history, line].slice(-MAX_HISTORY);
    this.back = 0;
    const outcome = await this.gate.run({ name: COMMAND, vehicles: [vehicle] }, () =>
      api.post('/vehicles/{v}/shell', { params: { path: { v: vehicle } }, body: { line, while_armed: whileArmed, wait_s: 0 } }),
    );
    if (!outcome.ok && outcome.problem.code !== DOUBLE_CLICK) this.lastProblem = { vehicle, problem: outcome.problem };
    return outcome.ok;
  }

  /** An earlier (1) or later (-1) line; the empty line after the newest. */
  recall(step: 1 | -1): string {
    this.back = Math.min(this.history.length, Math.max(0, this.back + step));
    return this.back === 0 ? '' : (this.history.at(-this.back) ?? '');
  }
}
