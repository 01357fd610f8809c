/**
 * Flying by stick: sends a gamepad's sticks 25 times a second to the vehicle for which a person has begun it, and to no other.
 * When they cannot be read (unplugged, tab hidden, window without focus), or another vehicle is selected, it sends neutral sticks
 * and commands Hold. The server sends nothing by itself: without frames the vehicle does what its parameters say.
 */

import { reasonUnreadable, type PadSnapshot, type PageState } from '../../vehicle/gamepad';
import { pressedActions, stickFrame, type ButtonAction, type Mapping } from './mapping';

export const RATE_HZ = 25;
/** A frame is dropped while so much waits in the browser: an old stick that arrives late is worse than none [bytes]. */
const MAX_BUFFERED_BYTES = 1000;
const OPEN = 1;

export type FlightPhase = 'connecting' | 'centre' | 'flying' | 'interrupted';

/** The members of a WebSocket that are used here. */
export interface SocketLike {
  readyState: number;
  bufferedAmount: number;
  onclose: ((event: CloseEvent) => void) | null;
  onmessage: ((event: MessageEvent) => void) | null;
  send(data: string): void;
  close(): void;
}

/** Functions of the page that flying by stick uses. */
export interface FlightHost {
  openSocket: (vehicle: string) => SocketLike;
  selectedId: () => string | null;
  inAir: (vehicle: string) => boolean;
  /** Commands Hold for this vehicle; returns when it is answered, also when it was refused. */
  hold: (vehicle: Flown) => Promise<unknown>;
  /** A pressed button that the page has an action for. */
  act: (action: 'land' | 'arm', vehicle: string) => void;
}

export interface Flown {
  readonly id: string;
  readonly name: string;
}

export class StickFlight {
  /** The vehicle that is flown; null: none. */
  flown = $state.raw<Flown | null>(null);
  phase = $state<FlightPhase>('connecting');
  /** What has interrupted the sticks. */
  reason = $state<string | null>(null);
  /** Why the sticks cannot be read now; null: they can. */
  unreadable = $state<string | null>(null);
  /** Why the last flight by stick ended; null: a person ended it. */
  endReason = $state<string | null>(null);
  /** Index of the gamepad that flies. */
  private padIndex = 0;
  private socket: SocketLike | null = null;
  private isEnding = false;
  private pressed: readonly boolean[] = [];

  constructor(private readonly host: FlightHost) {}

  /** Begins with the gamepad that is shown; the sticks act once they were centred. */
  begin({ id, name }: Flown, pad: PadSnapshot): void {
    if (this.flown !== null) return;
    this.flown = { id, name };
    this.padIndex = pad.index;
    this.pressed = pad.pressed;
    this.phase = 'connecting';
    this.reason = this.unreadable = this.endReason = null;
    this.isEnding = false;
    const socket = (this.socket = this.host.openSocket(id));
    socket.onmessage = (event) => this.hear(socket, event.data);
    socket.onclose = () => {
      if (this.socket === socket) this.finish('The connection to the server ended.');
    };
  }

  /** Ends: neutral sticks, Hold in the air, then no more. @param reason null: a person ended it. */
  stop(reason: string | null = null): void {
    const { flown, socket } = this;
    if (flown === null || this.isEnding) return;
    this.isEnding = true;
    this.send({ type: 'neutral' });
    const end = (): void => {
      if (this.socket !== socket) return;
      this.send({ type: 'end' });
      this.finish(reason);
    };
    if (this.host.inAir(flown.id)) void this.host.hold(flown).finally(end);
    else end();
  }

  /** Goes on after a command has interrupted the sticks. */
  goOn(): void {
    if (this.phase === 'interrupted' && this.unreadable === null) this.send({ type: 'resume' });
  }

  /** Called 25 times a second, and when the page is hidden or a gamepad is unplugged. */
  tick(pads: readonly PadSnapshot[], page: PageState, mapping: Mapping): void {
    const { flown } = this;
    if (flown === null) return;
    if (this.host.selectedId() !== flown.id) this.stop('Another vehicle was selected.');
    const pad = pads.find((each) => each.index === this.padIndex) ?? null;
    const unreadable = reasonUnreadable(pad, page);
    if (unreadable !== null && this.unreadable === null && !this.isEnding && this.host.inAir(flown.id)) void this.host.hold(flown);
    this.unreadable = unreadable;
    if (this.flown === null) return;
    if (this.isEnding || pad === null || unreadable !== null) {
      this.send({ type: 'neutral' });
      return;
    }
    this.send(stickFrame(mapping, pad));
    const actions = pressedActions(mapping, this.pressed, pad);
    this.pressed = pad.pressed;
    for (const action of actions) this.act(action, flown);
  }

  private act(action: ButtonAction, flown: Flown): void {
    if (action === 'hold') void this.host.hold(flown);
    else if (action === 'stop') this.stop();
    else if (action === 'go_on') this.goOn();
    else this.host.act(action, flown.id);
  }

  private hear(socket: SocketLike, data: unknown): void {
    if (this.socket !== socket || typeof data !== 'string') return;
    const answer = JSON.parse(data) as { phase?: FlightPhase | 'off'; reason?: string | null; error?: { detail: string; remedy?: string | null } };
    if (answer.error !== undefined) {
      if (this.phase === 'connecting') this.finish([answer.error.detail, answer.error.remedy].filter(Boolean).join(' '));
    } else if (answer.phase === 'off') this.finish(answer.reason ?? null);
    else if (answer.phase !== undefined) {
      this.phase = answer.phase;
      this.reason = answer.reason ?? null;
    }
  }

  private send(message: object): void {
    const { socket } = this;
    if (socket === null || socket.readyState !== OPEN || socket.bufferedAmount > MAX_BUFFERED_BYTES) return;
    socket.send(JSON.stringify(message));
  }

  private finish(reason: string | null): void {
    const { socket } = this;
    this.socket = null;
    this.flown = null;
    this.unreadable = null;
    this.endReason = reason;
    socket?.close();
  }
}
