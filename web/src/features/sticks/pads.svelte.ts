/** Reads the gamepads, and passes the chosen one to flying by stick and to the gimbal. */

import type { components } from '../../api/schema';
import { connectedPads, pageState, reasonUnreadable, type PadSnapshot } from '../../vehicle/gamepad';
import { RATE_HZ, StickFlight, type FlightHost, type Flown } from './flight.svelte';
import { gimbalRates, mappingOf, type Mapping } from './mapping';

export class Pads {
  /** The connected gamepads at the newest reading. */
  all = $state.raw<readonly PadSnapshot[]>([]);
  /** Index of the gamepad that a person has chosen; null: the first. */
  private chosenIndex = $state<number | null>(null);
  /** The vehicle whose gimbal is turned; null: none. */
  turned = $state.raw<Flown | null>(null);
  /** Why turning the gimbal ended; null: a person ended it. */
  turnEndReason = $state<string | null>(null);
  readonly flight: StickFlight;
  private watchers = 0;
  private timer: ReturnType<typeof setInterval> | null = null;
  private sentRates = { pitch: 0, yaw: 0 };

  constructor(
    private readonly host: FlightHost,
    private readonly settings: () => components['schemas']['Gamepad'] | null,
    /** Turns the selected gimbal of a vehicle [deg/s]. */
    private readonly turnGimbal: (vehicle: string, rates: { pitch: number; yaw: number }) => void,
  ) {
    this.flight = new StickFlight(host);
  }

  get mapping(): Mapping {
    return mappingOf(this.settings());
  }

  /** The chosen gamepad; null: none is connected. */
  get pad(): PadSnapshot | null {
    return this.all.find((each) => each.index === this.chosenIndex) ?? this.all[0] ?? null;
  }

  choose(index: number): void {
    if (this.flight.flown === null && this.turned === null) this.chosenIndex = index;
  }

  /** Reads the gamepads while a part of the page shows them. @returns a function that ends it. */
  watch(): () => void {
    this.watchers += 1;
    this.tick();
    this.schedule();
    return () => {
      this.watchers -= 1;
      this.schedule();
    };
  }

  fly(vehicle: Flown): void {
    if (this.pad === null) return;
    this.chosenIndex = this.pad.index; // another gamepad that is connected meanwhile does not take its place
    this.flight.begin(vehicle, this.pad);
    this.schedule();
  }

  /** Begins to turn the gimbal by stick. */
  turn({ id, name }: Flown): void {
    if (this.pad === null) return;
    this.chosenIndex = this.pad.index;
    this.turnEndReason = null;
    this.turned = { id, name };
    this.schedule();
  }

  /** Both axes of the gimbal stop. @param reason null: a person ended it. */
  stopTurning(reason: string | null = null): void {
    const { turned } = this;
    if (turned === null) return;
    this.turned = null;
    this.turnEndReason = reason;
    this.sendRates(turned, { pitch: 0, yaw: 0 });
    this.schedule();
  }

  /** One reading; also called by events of the page, which a hidden tab's timers would miss. */
  readonly tick = (): void => {
    this.all = connectedPads();
    const state = pageState();
    const { mapping, turned } = this;
    this.flight.tick(this.all, state, mapping);
    if (turned !== null) {
      const pad = this.all.find((each) => each.index === this.chosenIndex) ?? null;
      const isOther = this.host.selectedId() !== turned.id;
      const reason = isOther ? 'Another vehicle was selected.' : reasonUnreadable(pad, state);
      if (reason !== null || pad === null) this.stopTurning(reason);
      else this.sendRates(turned, gimbalRates(mapping, pad));
    }
    this.schedule();
  };

  private sendRates(vehicle: Flown, rates: { pitch: number; yaw: number }): void {
    if (rates.pitch === this.sentRates.pitch && rates.yaw === this.sentRates.yaw) return;
    this.sentRates = rates;
    this.turnGimbal(vehicle.id, rates);
  }

  private schedule(): void {
    const isNeeded = this.watchers > 0 || this.flight.flown !== null || this.turned !== null;
    if (isNeeded === (this.timer !== null)) return;
    const change = isNeeded ? 'addEventListener' : 'removeEventListener';
    for (const name of ['blur', 'pagehide', 'gamepaddisconnected'] as const) window[change](name, this.tick);
    document[change]('visibilitychange', this.tick);
    if (this.timer !== null) clearInterval(this.timer);
    this.timer = isNeeded ? setInterval(this.tick, 1000 / RATE_HZ) : null;
  }
}
