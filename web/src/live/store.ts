/**
 * All telemetry, outside the UI framework: frames are stored when they arrive, and the page reads them once per
 * animation frame. Estimates the server's clock, so that ages are right although this computer's clock may be wrong;
 * replays do not change the estimate.
 */

import { VehicleState } from './vehicle-state';
import type { Frame, Replay, WireEvent, WireSample } from './wire';

export class TelemetryStore {
  readonly vehicles = new Map<string, VehicleState>();
  /** Incremented with each frame; the page repaints when it has changed. */
  revision = 0;
  /** Events without a vehicle, such as links and warnings; newest first. */
  stationEvents: WireEvent[] = [];
  /** Whether the telemetry socket is open; if not, all values are old. */
  connected = false;
  /** The open replays. */
  replays: readonly Replay[] = [];
  private readonly localUnixS: () => number;
  private offset_s: number | null = null;
  private sorted: readonly string[] | null = null;

  /** @param localUnixS this computer's clock [s], replaced in tests. */
  constructor(localUnixS: () => number = () => Date.now() / 1000) {
    this.localUnixS = localUnixS;
  }

  /** The present time [unix s]: the server's; for a replayed vehicle that of its recording. */
  nowUnixS(vehicleId: string | null = null): number {
    return this.replayOf(vehicleId)?.position_unix_s ?? this.localUnixS() + (this.offset_s ?? 0);
  }

  /** The replay that a vehicle belongs to. */
  replayOf(vehicleId: string | null): Replay | null {
    if (vehicleId === null) return null;
    return this.replays.find((replay) => replay.vehicles.includes(vehicleId)) ?? null;
  }

  /** Ids sorted by number; the same array until a vehicle appears or disappears. */
  ids(): readonly string[] {
    this.sorted ??= [...this.vehicles.keys()].sort((a, b) => a.localeCompare(b, undefined, { numeric: true }));
    return this.sorted;
  }

  /** Whether one of these vehicles is known to be armed. */
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
      this.replays = []; // of the earlier connection
    } else if (frame.type === 'samples') for (const sample of frame.samples) this.applySample(sample);
    else if (frame.type === 'event') this.applyEvent(frame.event);
    else if (frame.type === 'replays') this.replays = frame.replays;
    this.revision += 1;
  }

  /**
   * Removes vehicles that the server no longer lists, for example after its restart. @returns whether there were any.
   */
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
    if (!vehicle.isLive || this.replayOf(sample.vehicle) !== null) return; // a replay has its own time
    // A sample cannot come from the server's future: the estimate of its clock was too early.
    const ahead_s = sample.received_unix_s - this.nowUnixS();
    if (ahead_s > 0) this.offset_s = (this.offset_s ?? 0) + ahead_s;
  }

  private applyEvent(event: WireEvent): void {
    if (event.kind === 'vehicle_removed' && event.vehicle !== null) {
      this.vehicles.delete(event.vehicle);
      this.sorted = null;
      return;
    }
    if (event.kind === 'progress' || event.kind === 'operation') return; // belongs to one command or operation, whose sender handles it itself
    if (event.kind === 'readiness') return; // the topic of the same name has the content
    // A live event about a replayed vehicle has the present time, so it is not added to the messages of the recording.
    if (event.vehicle !== null && event['replayed'] === true) this.vehicle(event.vehicle);
    else if (event.vehicle !== null) this.vehicle(event.vehicle).addMessage(event);
    else this.stationEvents = [event, ...this.stationEvents].slice(0, 50);
  }
}
