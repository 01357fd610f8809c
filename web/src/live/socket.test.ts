import { describe, expect, it } from 'vitest';
import { RESPONSE_TIMEOUT_MS, retryDelayMs, RESUBSCRIBE_AFTER_MS, TelemetrySocket, type SocketLike, type SocketState } from './socket';
import type { Frame } from './wire';

class FakeSocket implements SocketLike {
  sent: string[] = [];
  closed = false;
  onopen: (() => void) | null = null;
  onmessage: ((event: { data: unknown }) => void) | null = null;
  onclose: (() => void) | null = null;
  send(data: string): void {
    this.sent.push(data);
  }
  close(): void {
    this.closed = true;
  }
}

function setup() {
  const sockets: FakeSocket[] = [];
  const frames: Frame[] = [];
  const states: SocketState[] = [];
  let timers: { due_ms: number; run: () => void }[] = [];
  let now_ms = 0;
  const server = { hasVehicles: true };
  const socket = new TelemetrySocket(
    'ws://x',
    () => ({ vehicles: '*', topics: ['gps'], rate_hz: 25 }),
    (f) => frames.push(f),
    (s) => states.push(s),
    () => server.hasVehicles,
    {
      open: () => {
        const opened = new FakeSocket();
        sockets.push(opened);
        return opened;
      },
      nowMs: () => now_ms,
      setTimer: (run, ms) => {
        const timer = { due_ms: now_ms + ms, run };
        timers.push(timer);
        return timer;
      },
      clearTimer: (timer) => (timers = timers.filter((t) => t !== timer)),
    },
  );
  const passTime = (ms: number): void => {
    now_ms += ms;
    const dueTimers = timers.filter((t) => t.due_ms <= now_ms);
    timers = timers.filter((t) => t.due_ms > now_ms);
    for (const timer of dueTimers) timer.run();
  };
  return { socket, sockets, frames, states, passTime, server };
}

const HELLO = '{"type":"hello","schema_version":1,"server_time_unix_s":5}';

describe('telemetry socket', () => {
  it('subscribes when it opens, and passes frames to the page', () => {
    const { socket, sockets, frames } = setup();
    socket.start();
    sockets[0]?.onopen?.();
    expect(JSON.parse(sockets[0]?.sent[0] ?? '')).toEqual({ type: 'subscribe', vehicles: '*', topics: ['gps'], rate_hz: 25 });
    sockets[0]?.onmessage?.({ data: HELLO });
    expect(socket.state.phase).toBe('open');
    expect(frames).toHaveLength(1);
  });
  it('subscribes again if no frames arrive, and closes the connection if there is still no frame', () => {
    const { socket, sockets, passTime } = setup();
    socket.start();
    const firstSocket = sockets[0];
    firstSocket?.onopen?.();
    firstSocket?.onmessage?.({ data: HELLO });
    const passSeconds = (count: number): void => {
      for (let i = 0; i < count; i++) passTime(1000);
    };
    passSeconds(RESUBSCRIBE_AFTER_MS / 1000);
    expect(firstSocket?.sent).toHaveLength(2); // the connection may still be open: a vehicle whose link is lost causes no frames
    firstSocket?.onmessage?.({ data: '{"type":"samples","samples":[]}' });
    passSeconds(RESUBSCRIBE_AFTER_MS / 1000 - 1);
    expect(socket.state.phase).toBe('open');
    passSeconds(RESPONSE_TIMEOUT_MS / 1000 + 1);
    expect(socket.state.phase).toBe('waiting');
    expect(firstSocket?.closed).toBe(true);
  });
  it('does not subscribe again while the server has no vehicles', () => {
    const { socket, sockets, passTime, server } = setup();
    server.hasVehicles = false;
    socket.start();
    sockets[0]?.onopen?.();
    sockets[0]?.onmessage?.({ data: HELLO });
    for (let i = 0; i < 60; i++) passTime(1000);
    expect(sockets[0]?.sent).toHaveLength(1);
    expect(socket.state.phase).toBe('open');
  });
  it('reconnects automatically, after a longer delay each time, and reports each delay', () => {
    const { socket, sockets, states, passTime } = setup();
    socket.start();
    sockets[0]?.onclose?.();
    expect(states.at(-1)).toEqual({ phase: 'waiting', attempt: 2, retryAt_ms: 500 });
    passTime(500);
    expect(sockets).toHaveLength(2);
    sockets[1]?.onclose?.();
    expect(states.at(-1)).toMatchObject({ phase: 'waiting', retryAt_ms: 1500 });
    expect([1, 2, 3, 9].map(retryDelayMs)).toEqual([500, 1000, 2000, 8000]);
  });
  it('closes a connection that sends no hello frame', () => {
    const { socket, sockets, passTime } = setup();
    socket.start();
    passTime(8000);
    expect(sockets[0]?.closed).toBe(true);
    expect(socket.state.phase).toBe('waiting');
  });
  it('reconnects immediately if requested while it waits', () => {
    const { socket, sockets } = setup();
    socket.start();
    socket.retryNow();
    expect(sockets).toHaveLength(1);
    sockets[0]?.onclose?.();
    socket.retryNow();
    expect(sockets).toHaveLength(2);
  });
  it('rejects another schema version', () => {
    const { socket, sockets, frames } = setup();
    socket.start();
    sockets[0]?.onmessage?.({ data: HELLO.replace('"schema_version":1', '"schema_version":2') });
    expect(socket.state).toEqual({ phase: 'incompatible', schemaVersion: 2 });
    expect(frames).toHaveLength(0);
  });
  it('stays closed once stopped', () => {
    const { socket, sockets, passTime } = setup();
    socket.start();
    socket.stop();
    passTime(60_000);
    expect(sockets).toHaveLength(1);
    expect(sockets[0]?.closed).toBe(true);
  });
});
