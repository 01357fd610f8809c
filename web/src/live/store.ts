/**
 * All telemetry, outside the UI framework: frames go in as they come, the page reads once per animation frame.
 * Knows the server's clock, so that ages are right on a machine whose own clock is not; a recording never sets it.
 */

import { VehicleState } from './vehicle-state';
import type { Frame, Replay, WireEvent, WireSample } from './wire';

export class TelemetryStore {
  readonly vehicles = new Map<string, VehicleState>();
  /** Changes whenever something arrived: the painter compares it. */
  revision = 0;
  /** What concerns no single vehicle: links, warnings; newest first. */
  stationEvents: WireEvent[] = [];
  /** Whether the telemetry socket is open: else all of this is old. */
  connected = false;
  /** What is played now. */
  replays: readonly Replay[] = [];
  private readonly localUnixS: () => number;
  private offset_s: number | null = null;
  private sorted: readonly string[] | null = null;

  /** @param localUnixS this machine's clock [s], injected for the tests. */
  constructor(localUnixS: () => number = () => Date.now() / 1000) {
    this.localUnixS = localUnixS;
  }

  /** The time now [unix s]: the server's, or for a replayed vehicle the moment of its recording. */
  nowUnixS(vehicleId: string | null = null): number {
    return this.replayOf(vehicleId)?.position_unix_s ?? this.localUnixS() + (this.offset_s ?? 0);
  }

  /** The replay that shows a vehicle. */
  replayOf(vehicleId: string | null): Replay | null {
    if (vehicleId === null) return null;
    return this.replays.find((replay) => replay.vehicles.includes(vehicleId)) ?? null;
  }

  /** In the order of their numbers; the same array until a vehicle comes or goes. */
  ids(): readonly string[] {
    this.sorted ??= [...this.vehicles.keys()].sort((a, b) => a.localeCompare(b, undefined, { numeric: true }));
    return this.sorted;
  }

  /** Whether one of these vehicles is armed, as far as it has been told. */
  isArmed(ids: readonly string[]): boolean {
    return ids.some((id) => this.vehicles.get(id)?.armed ?? false);
  }

  vehicle(id: string): VehicleState {
    let state = this.vehicles.get(id);
    if (state === undefined) {
      state = new VehicleState(id);
      this.vehicles.set(id, state);
      this.sorted = null;
    }
    return state;
  }

  apply(frame: Frame): void {
    if (frame.type === 'hello') {
      this.offset_s = frame.server_time_unix_s - this.localUnixS();
      this.replays = []; // of the connection before
    } else if (frame.type === 'samples') for (const sample of frame.samples) this.applySample(sample);
    else if (frame.type === 'event') this.applyEvent(frame.event);
    else if (frame.type === 'replays') this.replays = frame.replays;
    this.revision += 1;
  }

  /** Forgets vehicles the server no longer lists (a restarted server starts from nothing); says whether there were any. */
  keepOnly(ids: readonly string[]): boolean {
    const gone = [...this.vehicles.keys()].filter((id) => !ids.includes(id));
    for (const id of gone) this.vehicles.delete(id);
    this.sorted = null;
    for (const id of ids) this.vehicle(id);
    this.revision += 1;
    return gone.length > 0;
  }

  private applySample(sample: WireSample): void {
    const vehicle = this.vehicle(sample.vehicle);
    vehicle.apply(sample);
    if (!vehicle.isLive || this.replayOf(sample.vehicle) !== null) return; // a recording has a time of its own
    // A sample cannot have been received in the server's future: such a one corrects our idea of its clock.
    const ahead_s = sample.received_unix_s - this.nowUnixS();
    if (ahead_s > 0) this.offset_s = (this.offset_s ?? 0) + ahead_s;
  }

  private applyEvent(event: WireEvent): void {
    if (event.kind === 'vehicle_removed' && event.vehicle !== null) {
      this.vehicles.delete(event.vehicle);
      this.sorted = null;
      return;
    }
    if (event.kind === 'progress' || event.kind === 'operation') return; // of one command or operation only; who asked listens itself
    if (event.kind === 'readiness') return; // the topic of that name says what has changed
    // A recording's messages are of its own time: that it was opened now is none of them.
    if (event.vehicle !== null && event['replayed'] === true) this.vehicle(event.vehicle);
    else if (event.vehicle !== null) this.vehicle(event.vehicle).say(event);
    else this.stationEvents = [event, ...this.stationEvents].slice(0, 50);
  }
}
