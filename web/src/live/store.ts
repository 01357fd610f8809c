/**
 * All telemetry, outside the UI framework: the store contains the data of all received frames, and the page reads it once
 * per animation frame. The store estimates the server's clock, so that ages are correct even if this computer's clock is
 * wrong; replays do not change the estimate.
 */

import { VehicleState } from './vehicle-state';
import type { Frame, Replay, WireEvent, WireSample } from './wire';

export class TelemetryStore {
  readonly vehicles = new Map<string, VehicleState>();
  /** Incremented with each change; the page then repaints. */
  revision = 0;
  /** Events without a vehicle, for example about links; newest first. */
  serverEvents: WireEvent[] = [];
  /** Whether the telemetry socket is open; if not, the page shows all values as old. */
  connected = false;
  /** The open replays. */
  replays: readonly Replay[] = [];
  private readonly localUnixS: () => number;
  /** Server's clock minus this computer's clock; null: not known. */
  private clockOffset_s: number | null = null;
  private sortedIds: readonly string[] | null = null;

  /** @param localUnixS this computer's clock [s], replaced in tests. */
  constructor(localUnixS: () => number = () => Date.now() / 1000) {
    this.localUnixS = localUnixS;
  }

  /** The present time by the server's clock [unix s]; for a replayed vehicle the replay's time. */
  nowUnixS(vehicleId: string | null = null): number {
    return this.replayOf(vehicleId)?.position_unix_s ?? this.localUnixS() + (this.clockOffset_s ?? 0);
  }

  /** The replay that contains a vehicle; null: the vehicle is not replayed. */
  replayOf(vehicleId: string | null): Replay | null {
    if (vehicleId === null) return null;
    return this.replays.find((replay) => replay.vehicles.includes(vehicleId)) ?? null;
  }

  /** Ids sorted by number; the same array until a vehicle appears or disappears. */
  ids(): readonly string[] {
    this.sortedIds ??= [...this.vehicles.keys()].sort((a, b) => a.localeCompare(b, undefined, { numeric: true }));
    return this.sortedIds;
  }

  /** Whether at least one of these vehicles is armed. */
  isArmed(ids: readonly string[]): boolean {
    return ids.some((id) => this.vehicles.get(id)?.armed ?? false);
  }

  /** The vehicle's state; a new state for a new id. */
  vehicle(id: string): VehicleState {
    let state = this.vehicles.get(id);
    if (state === undefined) {
      state = new VehicleState(id);
      this.vehicles.set(id, state);
      this.sortedIds = null;
    }
    return state;
  }

  apply(frame: Frame): void {
    if (frame.type === 'hello') {
      this.clockOffset_s = frame.server_time_unix_s - this.localUnixS();
      this.replays = []; // the replays of the earlier connection
    } else if (frame.type === 'samples') for (const sample of frame.samples) this.applySample(sample);
    else if (frame.type === 'event') this.applyEvent(frame.event);
    else if (frame.type === 'replays') this.replays = frame.replays;
    this.revision += 1;
  }

  /**
   * Removes vehicles that the server no longer lists, for example after a restart of the server, and adds new vehicles.
   * @param ids the vehicles that the server lists.
   * @returns whether a vehicle was removed.
   */
  keepOnly(ids: readonly string[]): boolean {
    const removedIds = [...this.vehicles.keys()].filter((id) => !ids.includes(id));
    for (const id of removedIds) this.vehicles.delete(id);
    this.sortedIds = null;
    for (const id of ids) this.vehicle(id);
    this.revision += 1;
    return removedIds.length > 0;
  }

  private applySample(sample: WireSample): void {
    const vehicle = this.vehicle(sample.vehicle);
    vehicle.apply(sample);
    if (!vehicle.isLive || this.replayOf(sample.vehicle) !== null) return; // a replay has its own time
    // A sample cannot be later than the server's clock; if it seems later, the estimated clock is behind.
    const ahead_s = sample.received_unix_s - this.nowUnixS();
    if (ahead_s > 0) this.clockOffset_s = (this.clockOffset_s ?? 0) + ahead_s;
  }

  private applyEvent(event: WireEvent): void {
    if (event.kind === 'vehicle_removed' && event.vehicle !== null) {
      this.vehicles.delete(event.vehicle);
      this.sortedIds = null;
      return;
    }
    if (event.kind === 'progress' || event.kind === 'operation') return; // the sender of the command or operation handles these events
    if (event.kind === 'readiness') return; // the topic `readiness` has the content
    // A live event about a replayed vehicle has the present time, so it does not belong to the messages of the recording.
    if (event.vehicle !== null && event['replayed'] === true) this.vehicle(event.vehicle);
    else if (event.vehicle !== null) this.vehicle(event.vehicle).addMessage(event);
    else this.serverEvents = [event, ...this.serverEvents].slice(0, 50);
  }
}
