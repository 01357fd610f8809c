import { describe, expect, it, vi } from 'vitest';
import type { PadSnapshot } from '../../vehicle/gamepad';
import { StickFlight, type FlightHost, type SocketLike } from './flight.svelte';
import { deflection, gimbalRates, mappingOf, missingControls, PRESETS, presetOf, pressedActions, stickFrame, type Mapping } from './mapping';

const pad = (axes: number[], pressed: number[] = [], index = 0): PadSnapshot => ({
  index,
  id: 'pad',
  axes,
  pressed: Array.from({ length: 17 }, (_, button) => pressed.includes(button)),
});
const MODE_2 = mappingOf(null);
const EXACT: Mapping = { ...MODE_2, deadZone: 0 };

describe('the mapping', () => {
  it('is mode 2 without settings: the left stick is throttle and yaw, pushing it forward climbs', () => {
    expect(presetOf(MODE_2)).toBe('Mode 2');
    expect(stickFrame(EXACT, pad([0.5, -1, 0, 0]))).toEqual({ type: 'sticks', pitch: 0, roll: 0, throttle: 1000, yaw: 500 });
    expect(stickFrame(EXACT, pad([0, 0, -0.25, -1]))).toEqual({ type: 'sticks', pitch: 1000, roll: -250, throttle: 500, yaw: 0 });
    expect(stickFrame(EXACT, pad([0, 1, 0, 0])).throttle).toBe(0);
  });

  it('of mode 1 has pitch on the left and throttle on the right', () => {
    const mode1 = mappingOf(PRESETS[0]?.axes ?? {});
    expect(presetOf(mode1)).toBe('Mode 1');
    expect(stickFrame({ ...mode1, deadZone: 0 }, pad([0, -1, 0, 0]))).toMatchObject({ pitch: 1000, throttle: 500 });
    expect(stickFrame({ ...mode1, deadZone: 0 }, pad([0, 0, 0, -1]))).toMatchObject({ pitch: 0, throttle: 1000 });
  });

  it('applies dead zone and expo, is never beyond full deflection, and reads no number as the middle', () => {
    expect(deflection(MODE_2, 'yaw', pad([0.05, 0, 0, 0]))).toBe(0);
    expect(deflection(MODE_2, 'yaw', pad([0.06, 0, 0, 0]))).toBeGreaterThan(0);
    expect(deflection({ ...EXACT, expo: 1 }, 'yaw', pad([0.5, 0, 0, 0]))).toBeCloseTo(0.125);
    for (const bad of [NaN, Infinity, -Infinity, 7, -7]) {
      const { pitch, roll, throttle, yaw } = stickFrame(EXACT, pad([bad, bad, bad, bad]));
      for (const value of [pitch, roll, yaw]) expect(Math.abs(value)).toBeLessThanOrEqual(1000);
      expect(throttle).toBeGreaterThanOrEqual(0);
      expect(throttle).toBeLessThanOrEqual(1000);
    }
    expect(stickFrame(EXACT, pad([NaN, NaN, NaN, NaN]))).toEqual({ type: 'sticks', pitch: 0, roll: 0, throttle: 500, yaw: 0 });
    expect(Object.values(stickFrame(MODE_2, pad([0, 0, 0, 0]))).some((value) => Object.is(value, -0))).toBe(false);
  });

  it('says which sticks have no axis', () => {
    expect(missingControls(MODE_2, pad([0, 0]))).toEqual(['pitch', 'roll']);
    expect(missingControls(mappingOf({ yaw: { axis: null } }), pad([0, 0, 0, 0]))).toEqual(['yaw']);
    expect(missingControls(MODE_2, pad([0, 0, 0, 0]))).toEqual([]);
  });

  it('turns the gimbal in whole degrees per second, and not without an axis', () => {
    const mapping = { ...mappingOf({ gimbal_pitch: { axis: 1, reverse: true }, gimbal_rate_deg_s: 20 }), deadZone: 0 };
    expect(gimbalRates(mapping, pad([0, -0.501, 1, 1]))).toEqual({ pitch: 10, yaw: 0 });
  });

  it('takes a button when it is pressed, not while it is held or when the gamepad is first seen', () => {
    const mapping = mappingOf({ buttons: [{ button: 3, action: 'stop' }] });
    expect(pressedActions(mapping, pad([]).pressed, pad([], [3]))).toEqual(['stop']);
    expect(pressedActions(mapping, pad([], [3]).pressed, pad([], [3]))).toEqual([]);
    expect(pressedActions(mapping, [], pad([], [3]))).toEqual([]);
  });
});

class FakeSocket implements SocketLike {
  readyState = 1;
  bufferedAmount = 0;
  onclose: ((event: CloseEvent) => void) | null = null;
  onmessage: ((event: MessageEvent) => void) | null = null;
  readonly sent: { type: string }[] = [];
  isClosed = false;
  send(data: string): void {
    this.sent.push(JSON.parse(data) as { type: string });
  }
  close(): void {
    this.isClosed = true;
  }
  answer(message: object): void {
    this.onmessage?.({ data: JSON.stringify(message) } as MessageEvent);
  }
  get last(): string | undefined {
    return this.sent.at(-1)?.type;
  }
}

const SEEN = { visible: true, focused: true };
const CENTRED = pad([0, 0, 0, 0]);
const FORWARD = pad([0, 0, 0, -1]);

function rig() {
  const state = { selected: '1', inAir: true, held: [] as string[], acted: [] as string[], sockets: [] as { vehicle: string; socket: FakeSocket }[] };
  let answerHold: () => void = () => undefined;
  const host: FlightHost = {
    openSocket: (vehicle) => {
      const socket = new FakeSocket();
      state.sockets.push({ vehicle, socket });
      return socket;
    },
    selectedId: () => state.selected,
    inAir: () => state.inAir,
    hold: ({ id }) => {
      state.held.push(id);
      return new Promise<void>((resolve) => (answerHold = resolve));
    },
    act: (action, vehicle) => state.acted.push(`${action} ${vehicle}`),
  };
  const flight = new StickFlight(host);
  flight.begin({ id: '1', name: 'Quad 1' }, CENTRED);
  const socket = state.sockets[0]?.socket as FakeSocket;
  socket.answer({ phase: 'centre', reason: null });
  flight.tick([CENTRED], SEEN, MODE_2);
  socket.answer({ phase: 'flying', reason: null });
  flight.tick([FORWARD], SEEN, MODE_2);
  const holdAnswered = async (): Promise<void> => {
    answerHold();
    await vi.waitFor(() => expect(flight.flown).toBeNull());
  };
  return { flight, socket, state, holdAnswered };
}

describe('flying by stick', () => {
  it('sends the sticks to the vehicle for which it was begun', () => {
    const { flight, socket, state } = rig();
    expect(flight.phase).toBe('flying');
    expect(state.sockets.map(({ vehicle }) => vehicle)).toEqual(['1']);
    expect(socket.sent.at(-1)).toMatchObject({ type: 'sticks', pitch: 1000 });
  });

  it.each([
    ['is unplugged', [], SEEN, 'The gamepad was disconnected.'],
    ['is replaced by another', [pad([0, 0, 0, -1], [], 1)], SEEN, 'The gamepad was disconnected.'],
    ['is behind a hidden tab', [FORWARD], { ...SEEN, visible: false }, 'The page was hidden.'],
    ['is behind another window', [FORWARD], { ...SEEN, focused: false }, 'The window lost focus.'],
  ])('is neutral and commands Hold once when the gamepad %s', (_, pads, page, reason) => {
    const { flight, socket, state } = rig();
    for (let i = 0; i < 3; i++) flight.tick(pads, page, MODE_2);
    expect(socket.sent.slice(-3).map(({ type }) => type)).toEqual(['neutral', 'neutral', 'neutral']);
    expect(state.held).toEqual(['1']);
    expect(flight.unreadable).toBe(reason);
    // Readable again: the server keeps the sticks neutral until the pilot goes on, because Hold has interrupted them.
    socket.answer({ phase: 'interrupted', reason: 'Interrupted by “Hold”.' });
    flight.goOn();
    expect(socket.last).toBe('neutral');
    flight.tick([CENTRED], SEEN, MODE_2);
    flight.goOn();
    expect(socket.last).toBe('resume');
  });

  it('stops when another vehicle is selected, holds the flown one, and says so', async () => {
    const { flight, socket, state, holdAnswered } = rig();
    state.selected = '2';
    flight.tick([FORWARD], SEEN, MODE_2);
    flight.tick([FORWARD], SEEN, MODE_2);
    expect(state.held).toEqual(['1']);
    expect(socket.sent.slice(-3).every(({ type }) => type === 'neutral')).toBe(true);
    await holdAnswered();
    expect(socket.last).toBe('end');
    expect(socket.isClosed).toBe(true);
    expect(flight.endReason).toBe('Another vehicle was selected.');
    const count = socket.sent.length;
    flight.tick([FORWARD], SEEN, MODE_2);
    expect(socket.sent.length).toBe(count);
  });

  it('ends at once on the ground, without Hold', () => {
    const { flight, socket, state } = rig();
    state.inAir = false;
    flight.stop();
    expect(state.held).toEqual([]);
    expect([socket.last, socket.isClosed, flight.flown, flight.endReason]).toEqual(['end', true, null, null]);
  });

  it('drops a frame that could not be sent at once', () => {
    const { flight, socket } = rig();
    const count = socket.sent.length;
    socket.bufferedAmount = 5000;
    flight.tick([FORWARD], SEEN, MODE_2);
    expect(socket.sent.length).toBe(count);
  });

  it('gives the commands of its buttons: Hold at once, Land and Arm by the page’s confirmation', () => {
    const { flight, state } = rig();
    const mapping = mappingOf({
      buttons: [
        { button: 1, action: 'hold' },
        { button: 2, action: 'land' },
        { button: 3, action: 'arm' },
      ],
    });
    flight.tick([pad([0, 0, 0, 0], [1, 2, 3])], SEEN, mapping);
    flight.tick([pad([0, 0, 0, 0], [1, 2, 3])], SEEN, mapping);
    expect(state.held).toEqual(['1']);
    expect(state.acted).toEqual(['land 1', 'arm 1']);
  });

  it('ends with the server’s reason, and commands nothing then', () => {
    const { flight, socket, state } = rig();
    socket.answer({ phase: 'off', reason: 'bob has control of the vehicle now.' });
    expect([flight.flown, flight.endReason, state.held]).toEqual([null, 'bob has control of the vehicle now.', []]);
  });

  it('says why the server refused it', () => {
    const socket = new FakeSocket();
    const flight = new StickFlight({ openSocket: () => socket, selectedId: () => '1', inAir: () => true, hold: () => Promise.resolve(), act: () => undefined });
    flight.begin({ id: '1', name: 'Quad 1' }, CENTRED);
    socket.answer({ error: { detail: 'COM_RC_IN_MODE is 4.', remedy: 'Set it to 1.' } });
    expect([flight.flown, flight.endReason, socket.isClosed]).toEqual([null, 'COM_RC_IN_MODE is 4. Set it to 1.', true]);
  });
});
