/** The telemetry socket: subscribes, passes frames to its owner, reconnects automatically and reports its state. */

import { parseFrame, SCHEMA_VERSION, type Frame } from './wire';

export type SocketState =
  | { phase: 'connecting'; attempt: number }
  | { phase: 'open' }
  | { phase: 'waiting'; attempt: number; retryAt_ms: number }
  | { phase: 'incompatible'; schemaVersion: number };

export interface SocketLike {
  send(data: string): void;
  close(): void;
  onopen: (() => void) | null;
  onmessage: ((event: { data: unknown }) => void) | null;
  onclose: (() => void) | null;
}

export interface SocketDeps {
  open: (url: string) => SocketLike;
  nowMs: () => number;
  setTimer: (callback: () => void, ms: number) => unknown;
  clearTimer: (timer: unknown) => void;
}

const FIRST_RETRY_MS = 500;
const MAX_RETRY_MS = 8000;
/** The hello frame must arrive within this time after the connection attempt [ms]. */
const OPEN_DEADLINE_MS = 8000;
/** If no frame arrives for this time [ms] although the server has vehicles, the page subscribes again, so that the server sends all values. */
export const RESUBSCRIBE_AFTER_MS = 6000;
/** If no frame arrives for this time [ms] after the new subscription, the connection is lost. Some browsers do not report that the network was unplugged. */
export const RESPONSE_TIMEOUT_MS = 4000;
const CHECK_INTERVAL_MS = 1000;

/** Delay before the given attempt [ms]: doubles up to 8 s. */
export function retryDelayMs(attempt: number): number {
  return Math.min(MAX_RETRY_MS, FIRST_RETRY_MS * 2 ** Math.max(0, attempt - 1));
}

export class TelemetrySocket {
  state: SocketState = { phase: 'connecting', attempt: 1 };
  private socket: SocketLike | null = null;
  private timer: unknown = null;
  private attempt = 1;
  private stopped = false;
  private monitorTimer: unknown = null;
  private receivedAt_ms = 0;
  private resubscribedAt_ms: number | null = null;

  constructor(
    private readonly url: string,
    private readonly subscription: () => object,
    private readonly onFrame: (frame: Frame) => void,
    private readonly onState: (state: SocketState) => void,
    /** Whether the server has vehicles, whose samples arrive as frames. */
    private readonly expectsFrames: () => boolean,
    private readonly deps: SocketDeps = browserDeps,
  ) {}

  start(): void {
    this.stopped = false;
    this.connect();
  }

  stop(): void {
    this.stopped = true;
    this.deps.clearTimer(this.timer);
    this.deps.clearTimer(this.monitorTimer);
    this.closeSocket();
  }

  /** Reconnects immediately if the socket waits, because a person pressed the button or the computer is online again. */
  retryNow(): void {
    if (this.state.phase !== 'waiting') return;
    this.deps.clearTimer(this.timer);
    this.connect();
  }

  /** Sends the changed subscription. */
  resubscribe(): void {
    if (this.state.phase === 'open' && this.socket !== null) this.subscribe(this.socket);
  }

  private subscribe(socket: SocketLike): void {
    socket.send(JSON.stringify({ type: 'subscribe', ...this.subscription() }));
  }

  private connect(): void {
    this.setState({ phase: 'connecting', attempt: this.attempt });
    const socket = this.deps.open(this.url);
    this.socket = socket;
    this.timer = this.deps.setTimer(() => this.onConnectionLost(socket), OPEN_DEADLINE_MS);
    socket.onopen = () => this.subscribe(socket);
    socket.onmessage = (event) => this.onMessage(socket, event.data);
    socket.onclose = () => this.onConnectionLost(socket);
  }

  private onMessage(socket: SocketLike, data: unknown): void {
    if (socket !== this.socket || typeof data !== 'string') return;
    this.receivedAt_ms = this.deps.nowMs();
    this.resubscribedAt_ms = null;
    const frame = parseFrame(data);
    if (frame === null) return;
    if (frame.type === 'hello') {
      if (frame.schema_version !== SCHEMA_VERSION) {
        this.setState({ phase: 'incompatible', schemaVersion: frame.schema_version });
        this.deps.clearTimer(this.timer);
        this.closeSocket();
        return;
      }
      this.deps.clearTimer(this.timer);
      this.attempt = 1;
      this.onFrame(frame);
      this.setState({ phase: 'open' });
      this.monitor(socket);
      return;
    }
    this.onFrame(frame);
  }

  /** Monitors the open socket until it closes. */
  private monitor(socket: SocketLike): void {
    this.deps.clearTimer(this.monitorTimer);
    this.monitorTimer = this.deps.setTimer(() => {
      if (socket !== this.socket) return;
      const now_ms = this.deps.nowMs();
      if (this.resubscribedAt_ms !== null && now_ms - this.resubscribedAt_ms >= RESPONSE_TIMEOUT_MS) return this.onConnectionLost(socket);
      if (this.resubscribedAt_ms === null && this.expectsFrames() && now_ms - this.receivedAt_ms >= RESUBSCRIBE_AFTER_MS) {
        this.resubscribedAt_ms = now_ms;
        this.subscribe(socket);
      }
      this.monitor(socket);
    }, CHECK_INTERVAL_MS);
  }

  private onConnectionLost(socket: SocketLike): void {
    if (socket !== this.socket || this.stopped) return;
    this.deps.clearTimer(this.timer);
    this.deps.clearTimer(this.monitorTimer);
    this.resubscribedAt_ms = null;
    this.closeSocket();
    const delay = retryDelayMs(this.attempt);
    this.attempt += 1;
    this.setState({ phase: 'waiting', attempt: this.attempt, retryAt_ms: this.deps.nowMs() + delay });
    this.timer = this.deps.setTimer(() => this.connect(), delay);
  }

  private closeSocket(): void {
    const socket = this.socket;
    this.socket = null;
    if (socket === null) return;
    socket.onopen = socket.onmessage = socket.onclose = null;
    socket.close();
  }

  private setState(state: SocketState): void {
    this.state = state;
    this.onState(state);
  }
}

/* v8 ignore next 6 */
const browserDeps: SocketDeps = {
  open: (url) => new WebSocket(url) as unknown as SocketLike,
  nowMs: () => performance.now(),
  setTimer: (callback, ms) => setTimeout(callback, ms),
  clearTimer: (timer) => clearTimeout(timer as number),
};
