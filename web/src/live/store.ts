/**
 * All telemetry, outside the UI framework: the store contains the data of all received frames, and the page reads it once
 * per animation frame. The store estimates the server's clock, so that ages are correct even if this computer's clock is
 * wrong; replays do not change the estimate.
 */

import { VehicleState } from './vehicle-state';
import type { Frame, Replay, WireEvent, WireSample } from './wire';

/** Time for which a frame determines the estimate of the server's clock [s]; at most twice this time. */
const CLOCK_WINDOW_S = 60;
/** Samples that come live show nearly the same offset [s] for this time [s]. */
const LIVE_TOLERANCE_S = 1;
const LIVE_AFTER_S = 3;

/**
 * Estimates the server's clock. A frame cannot be later than the server's clock, so the frame with the shortest way to this page
 * determines the estimate: the one with the largest offset of the last minutes. Older frames do not count, so that a server's clock
 * that was set, or one wrong time, does not make all values old for ever. A sample that was stored before it was sent does not show
 * the present time: it can only correct the estimate to a later time.
 */
class ServerClock {
  /** Largest offset in this window and in the window before. */
  private offsets_s: [number, number] = [-Infinity, -Infinity];
  private windowStart_s = -Infinity;
  /** The last samples of each vehicle that show the same offset, and since when. */
  private readonly runs = new Map<string, { readonly offset_s: number; readonly since_s: number }>();

  /** Server's clock minus this computer's clock; 0 before the first frame. */
  get offset_s(): number {
    const offset_s = Math.max(...this.offsets_s);
    return Number.isFinite(offset_s) ? offset_s : 0;
  }

  /** A new connection: the server's clock shows `server_unix_s` now. */
  start(server_unix_s: number, local_unix_s: number): void {
    this.runs.clear();
    this.offsets_s = [server_unix_s - local_unix_s, -Infinity];
    this.windowStart_s = local_unix_s;
  }

  observe(vehicle: string, received_unix_s: number, local_unix_s: number): void {
    const offset_s = received_unix_s - local_unix_s;
    let run = this.runs.get(vehicle);
    if (run === undefined || Math.abs(offset_s - run.offset_s) > LIVE_TOLERANCE_S) this.runs.set(vehicle, (run = { offset_s, since_s: local_unix_s }));
    const isLive = local_unix_s - run.since_s >= LIVE_AFTER_S;
    const age_s = local_unix_s - this.windowStart_s;
    if (isLive && age_s >= CLOCK_WINDOW_S) {
      this.offsets_s = [-Infinity, age_s < 2 * CLOCK_WINDOW_S ? this.offsets_s[0] : -Infinity];
      this.windowStart_s = local_unix_s;
    }
    if (isLive || offset_s > Math.max(...this.offsets_s)) this.offsets_s[0] = Math.max(this.offsets_s[0], offset_s);
  }
}

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
  private readonly clock = new ServerClock();
  private sortedIds: readonly string[] | null = null;

  /** @param localUnixS a clock of this computer that is never set [s], replaced in tests. */
  constructor(localUnixS: () => number = () => (performance.timeOrigin + performance.now()) / 1000) {
    this.localUnixS = localUnixS;
  }

  /** The present time by the server's clock [unix s]; for a replayed vehicle the replay's time. */
  nowUnixS(vehicleId: string | null = null): number {
    return this.replayOf(vehicleId)?.position_unix_s ?? this.localUnixS() + this.clock.offset_s;
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
      this.clock.start(frame.server_time_unix_s, this.localUnixS());
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
    this.clock.observe(sample.vehicle, sample.received_unix_s, this.localUnixS());
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
