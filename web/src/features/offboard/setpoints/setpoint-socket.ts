/**
 * Sends setpoints over one WebSocket; the server acknowledges each setpoint by its sequence number. A setpoint that cannot be sent
 * now is dropped, not queued: an old setpoint that arrives late is worse than no setpoint.
 */

import type { Problem } from '../../../api/problems';
import { parseProblem } from '../../../api/problems';

export interface Ack {
  seq: number;
  /** The setpoint after the limits were applied; null if the server refused the setpoint. */
  applied: Readonly<Record<string, unknown>> | null;
  /** The server's texts about what the limits changed, and why. */
  limited: readonly string[];
  problem: Problem | null;
  /** True if a newer setpoint replaced this one before the server sent it to the vehicle. */
  superseded: boolean;
  /** Time from sending to the acknowledgement [s]. */
  roundTrip_s: number;
}

export type SocketState = 'connecting' | 'open' | 'closed';

/** The members of a WebSocket that `SetpointSocket` uses. */
export interface SocketLike {
  readyState: number;
  bufferedAmount: number;
  onopen: ((event: Event) => void) | null;
  onclose: ((event: CloseEvent) => void) | null;
  onmessage: ((event: MessageEvent) => void) | null;
  send(data: string): void;
  close(): void;
}

const OPEN = 1;
/** A larger send buffer means that the network is too slow [bytes]. */
const MAX_BUFFERED_BYTES = 4096;
const MAX_UNACKNOWLEDGED = 256;

export class SetpointSocket {
  state: SocketState = 'connecting';
  /** Number of setpoints not sent because the network was too slow. */
  droppedCount = 0;
  private seq = 0;
  /** Sending times of the setpoints that the server has not acknowledged, by sequence number [s]. */
  private readonly sentTimes = new Map<number, number>();
  private readonly socket: SocketLike;

  constructor(
    url: string,
    private readonly nowS: () => number,
    private readonly onAck: (ack: Ack) => void,
    private readonly onState: (state: SocketState, reason: string | null) => void,
    openSocket: (url: string) => SocketLike = (socketUrl) => new WebSocket(socketUrl),
  ) {
    this.socket = openSocket(url);
    this.socket.onopen = () => this.setState('open', null);
    this.socket.onclose = (event) => this.setState('closed', event.reason === '' ? 'The connection to the server ended.' : event.reason);
    this.socket.onmessage = (event) => this.onMessage(event.data);
  }

  /** Sends the request now. @returns its sequence number; null if the request could not be sent. */
  send(request: object): number | null {
    if (this.socket.readyState !== OPEN) return null;
    if (this.socket.bufferedAmount > MAX_BUFFERED_BYTES) {
      this.droppedCount += 1;
      return null;
    }
    const seq = ++this.seq;
    this.sentTimes.set(seq, this.nowS());
    if (this.sentTimes.size > MAX_UNACKNOWLEDGED) this.sentTimes.delete(this.sentTimes.keys().next().value ?? seq);
    this.socket.send(JSON.stringify({ ...request, seq }));
    return seq;
  }

  close(): void {
    this.socket.onclose = null;
    this.socket.close();
    this.setState('closed', null);
  }

  private setState(state: SocketState, reason: string | null): void {
    if (this.state === 'closed') return;
    this.state = state;
    if (state === 'closed') this.sentTimes.clear();
    this.onState(state, reason);
  }

  private onMessage(data: unknown): void {
    const raw = parseObject(data);
    if (raw === null || typeof raw['seq'] !== 'number') return;
    const sent_s = this.sentTimes.get(raw['seq']);
    if (sent_s === undefined) return;
    this.sentTimes.delete(raw['seq']);
    this.onAck({ seq: raw['seq'], roundTrip_s: this.nowS() - sent_s, ...readAck(raw) });
  }
}

function parseObject(data: unknown): Record<string, unknown> | null {
  if (typeof data !== 'string') return null;
  try {
    const value: unknown = JSON.parse(data);
    return typeof value === 'object' && value !== null ? (value as Record<string, unknown>) : null;
  } catch {
    return null;
  }
}

/** Reads the server's acknowledgement of a setpoint. */
function readAck(raw: Readonly<Record<string, unknown>>): Pick<Ack, 'applied' | 'limited' | 'problem' | 'superseded'> {
  if (raw['error'] !== undefined && raw['error'] !== null) {
    const error = typeof raw['error'] === 'string' ? { detail: raw['error'] } : raw['error'];
    return { applied: null, limited: [], problem: parseProblem(409, error), superseded: false };
  }
  const applied = raw['applied'];
  const limited = raw['limited'];
  return {
    applied: typeof applied === 'object' && applied !== null ? (applied as Record<string, unknown>) : null,
    limited: Array.isArray(limited) ? limited.filter((l): l is string => typeof l === 'string') : [],
    problem: null,
    superseded: raw['superseded'] === true,
  };
}
