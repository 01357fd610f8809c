/**
 * The page's state: selected vehicle, connection, repaint counters. Telemetry is not reactive (`live/`). Instead,
 * `repaintCount` changes at most once per animation frame, and Svelte then repaints the components that read `facts`.
 */

import { ApiClient } from '../api/client';
import { TelemetryStore } from '../live/store';
import { TelemetrySocket, type SocketState } from '../live/socket';
import type { WireEvent } from '../live/wire';
import { isLarge, fleetSubscription, detailSubscription, type Subscription } from '../live/subscriptions';
import type { VehicleState } from '../live/vehicle-state';
import { readOffboard } from '../vehicle/offboard';
import { vehicleFacts, type VehicleFacts } from '../vehicle/facts';
import { loadFleet, loadHistory } from './backfill';
import { availableStorage, chosenName, loadIdentity, markUnloaded, setName } from './identity';
import { userSettings } from './settings.svelte';

/** Repaint interval without new data [ms], so that ages and remaining times advance. */
const QUIET_REPAINT_MS = 200;
/** Repaint interval of list and map for a large fleet [ms]. */
const FLEET_REPAINT_MS = 500;

class Page {
  readonly store = new TelemetryStore();
  private readonly tabStorage = availableStorage(() => sessionStorage);
  readonly identity = $state(
    loadIdentity(
      this.tabStorage,
      availableStorage(() => localStorage),
    ),
  );
  /** The API client. If the server rejects the token, the client reloads the page, and the server shows its sign-in page. */
  readonly api = new ApiClient(this.identity, () => location.reload());
  /** Socket for all vehicles and every event. */
  readonly socket: TelemetrySocket;
  /** Second socket, for a large fleet: receives all topics of the selected vehicle and of `neededVehicles`, but no events. */
  private readonly detailSocket: TelemetrySocket;
  private isDetailSocketOpen = false;
  /** The last sent subscriptions of both sockets as JSON: first the subscription of `socket`, then that of `detailSocket`. */
  private sentSubscriptions = '';
  /** Vehicles whose history has been requested. */
  private readonly historyRequested = new Set<string>();
  repaintCount = $state(0);
  /** Repaint counter of views that show all vehicles: like `repaintCount` for a small fleet, slower for a large fleet. */
  private fleetRepaintCount = $state(0);
  connection = $state.raw<SocketState>({ phase: 'connecting', attempt: 1 });
  /** The vehicle that the person chose; null: the first vehicle. */
  private chosenId = $state<string | null>(null);
  /** Called for each message from the telemetry sockets, also in a hidden tab. */
  readonly telemetryListeners: (() => void)[] = [];
  /** Called for each event of any vehicle. */
  readonly eventListeners: ((event: WireEvent) => void)[] = [];
  /** Topics of the values that the person chose to see, in addition to the topics that the page always reads. */
  private chosenTopics: readonly string[] = [];
  /**
   * Each function returns the ids of vehicles whose topics a feature needs although they are not selected; for example
   * vehicles whose setpoints this page renews.
   */
  readonly neededVehicles: (() => Iterable<string>)[] = [];
  /** Called when a person sends the vehicle a setpoint by the Offboard card, room, a drag or the gamepad: nothing else of this page may fly it then. */
  readonly setpointListeners: ((id: string) => void)[] = [];
  /** Called once per painted animation frame. */
  readonly paintListeners: (() => void)[] = [];

  constructor() {
    this.socket = new TelemetrySocket(
      this.socketUrl('/telemetry'),
      () => this.fleetSubscription(),
      (frame) => {
        this.store.apply(frame);
        if (frame.type === 'hello') void this.backfill();
        if (frame.type === 'hello') void this.loadKey();
        if (frame.type === 'hello') void userSettings.synchronize();
        if (frame.type === 'event') userSettings.hear(frame.event);
        if (frame.type === 'event' && frame.event.kind === 'vehicle_added') void this.backfill(frame.event.vehicle);
        if (frame.type === 'event') for (const listener of this.eventListeners) listener(frame.event);
        for (const listener of this.telemetryListeners) listener();
      },
      (state) => {
        this.connection = state;
        this.store.connected = state.phase === 'open';
        // The browser does not say why a socket was refused. So the page sends a request: if the server rejects the token, the client reloads the page.
        if (state.phase === 'waiting') void this.api.get('/version');
      },
      () => this.store.vehicles.size > 0,
    );
    this.detailSocket = new TelemetrySocket(
      this.socketUrl('/telemetry'),
      () => this.detailSubscription() ?? this.fleetSubscription(),
      (frame) => {
        if (frame.type !== 'samples') return;
        this.store.apply(frame);
        for (const listener of this.telemetryListeners) listener();
      },
      () => undefined,
      () => this.store.vehicles.size > 0,
    );
  }

  /** URL of a WebSocket of the API, with this page's identity. */
  socketUrl(path: string): string {
    const scheme = location.protocol === 'https:' ? 'wss:' : 'ws:';
    return `${scheme}//${location.host}/api/v1${path}?${new URLSearchParams({ client: this.identity.name, client_id: this.identity.id }).toString()}`;
  }

  /** The name that the person has given; empty: none. */
  get ownName(): string {
    return userSettings.user;
  }

  /** Sets the person's name for all pages of this browser, which then have this person's settings. */
  rename(name: string): void {
    const storage = availableStorage(() => localStorage);
    setName(this.identity, name, storage);
    void userSettings.become(chosenName(storage));
  }

  /** Loads this page's key, by which the server's messages identify this client. */
  private async loadKey(): Promise<void> {
    const me = await this.api.get('/me');
    if (me.ok) this.identity.key = me.value.key;
  }

  start(): void {
    userSettings.connect(this.api, chosenName(availableStorage(() => localStorage)));
    this.socket.start();
    window.addEventListener('pagehide', () => markUnloaded(this.tabStorage));
    window.addEventListener('online', () => this.socket.retryNow());
    document.addEventListener('visibilitychange', () => this.socket.retryNow());
    let paintedRevision = -1;
    let paintedAt_ms = 0;
    let fleetPaintedAt_ms = 0;
    const onAnimationFrame = (now_ms: number): void => {
      if (this.store.revision !== paintedRevision || now_ms - paintedAt_ms > QUIET_REPAINT_MS) {
        paintedRevision = this.store.revision;
        paintedAt_ms = now_ms;
        this.repaintCount += 1;
        if (!isLarge(this.store.vehicles.size) || now_ms - fleetPaintedAt_ms > FLEET_REPAINT_MS) {
          fleetPaintedAt_ms = now_ms;
          this.fleetRepaintCount += 1;
        }
        this.updateSubscription();
      }
      for (const listener of this.paintListeners) listener();
      requestAnimationFrame(onAnimationFrame);
    };
    requestAnimationFrame(onAnimationFrame);
  }

  /**
   * Reads telemetry or the time, which are not reactive. A `$derived` value or a component that calls this function is
   * computed again at each repaint.
   */
  eachRepaint<T>(read: () => T): T {
    void this.repaintCount;
    return read();
  }

  /** Like `eachRepaint`, for views that show all vehicles. */
  eachFleetRepaint<T>(read: () => T): T {
    void this.fleetRepaintCount;
    return read();
  }

  /** Sorted ids of all vehicles; the same array until a vehicle appears or disappears. */
  readonly ids = $derived(this.eachRepaint(() => this.store.ids()));

  readonly selectedId = $derived(this.chosenId !== null && this.ids.includes(this.chosenId) ? this.chosenId : (this.ids[0] ?? null));

  select(id: string): void {
    this.chosenId = id;
    this.updateSubscription();
    this.loadHistory();
  }

  /** The selected vehicle's stored state, not reactive. For lists that are too long to be part of `facts`. */
  get vehicle(): VehicleState | null {
    return this.selectedId === null ? null : (this.store.vehicles.get(this.selectedId) ?? null);
  }

  /** The facts of the selected vehicle in this animation frame; read reactively. */
  readonly facts: VehicleFacts | null = $derived(
    this.eachRepaint(() => (this.vehicle === null ? null : vehicleFacts(this.vehicle, this.store.nowUnixS(this.selectedId), this.store.connected))),
  );

  /** The facts of any vehicle in this animation frame; read reactively. */
  factsOf(id: string): VehicleFacts | null {
    return this.eachRepaint(() => this.factsNow(id));
  }

  /** The present facts of any vehicle; not reactive. For views of all vehicles, which `eachFleetRepaint` repaints. */
  factsNow(id: string): VehicleFacts | null {
    const vehicle = this.store.vehicles.get(id);
    return vehicle === undefined ? null : vehicleFacts(vehicle, this.store.nowUnixS(id), this.store.connected);
  }

  /** Identifies the vehicle that has this id now; null: none. The value changes when the vehicle is replaced by another. */
  identify(id: string): object | null {
    return this.store.vehicles.get(id)?.incarnation ?? null;
  }

  /** Whether the server streams setpoints to a vehicle now. */
  isStreaming(id: string): boolean {
    return readOffboard(this.store.vehicles.get(id)?.newestSample('offboard')?.value)?.streaming ?? false;
  }

  /** Sets the topics of the values that the person chose to see, and subscribes to them. */
  subscribeTopics(topics: readonly string[]): void {
    this.chosenTopics = topics;
    this.updateSubscription();
  }

  private fleetSubscription(): Subscription {
    return fleetSubscription(this.store.vehicles.size, this.chosenTopics, this.store.isArmed(this.store.ids()));
  }

  private detailSubscription(): Subscription | null {
    const ids = [...(this.selectedId === null ? [] : [this.selectedId]), ...this.neededVehicles.flatMap((read) => [...read()])];
    return detailSubscription(this.store.vehicles.size, ids, this.chosenTopics, this.store.isArmed(ids));
  }

  /** Sends the subscriptions that have changed. */
  private updateSubscription(): void {
    const details = this.detailSubscription();
    const fleet = JSON.stringify(this.fleetSubscription());
    const subscriptions = fleet + JSON.stringify(details);
    if (subscriptions === this.sentSubscriptions) return;
    if (!this.sentSubscriptions.startsWith(fleet)) this.socket.resubscribe();
    this.sentSubscriptions = subscriptions;
    if (details === null) {
      this.detailSocket.stop();
      this.isDetailSocketOpen = false;
    } else if (this.isDetailSocketOpen) this.detailSocket.resubscribe();
    else {
      this.detailSocket.start();
      this.isDetailSocketOpen = true;
    }
  }

  /** Loads the fleet and its history. @param addedId load only the history of this vehicle, which has just appeared; null: of all vehicles. */
  private async backfill(addedId: string | null = null): Promise<void> {
    const { ids, removedAny } = await loadFleet(this.api, this.store);
    if (removedAny) this.socket.resubscribe();
    if (removedAny && this.isDetailSocketOpen) this.detailSocket.resubscribe();
    if (addedId === null) this.historyRequested.clear();
    const historyIds = isLarge(ids.length) ? [] : ids.filter((id) => addedId === null || id === addedId);
    for (const id of historyIds) this.historyRequested.add(id);
    await Promise.all(historyIds.map((id) => loadHistory(this.api, this.store, id)));
    this.loadHistory();
  }

  /** Loads the selected vehicle's history; in a large fleet, a vehicle's history is loaded only on selection. */
  private loadHistory(): void {
    const id = this.selectedId;
    if (id === null || this.historyRequested.has(id) || !this.store.connected) return;
    this.historyRequested.add(id);
    void loadHistory(this.api, this.store, id);
  }
}

export const page = new Page();
