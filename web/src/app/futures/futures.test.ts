import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';
import { ApiClient } from '../../api/client';
import type { CommandToConfirm } from '../actions/command.svelte';
import type { LayerContent } from '../map-layers.svelte';
import { futuresLayer, futuresTexts, type Futures } from './futures';
import { FuturesOfConfirmation } from './futures.svelte';

const FENCE = { name: 'geofence', distance_m: 14, t_s: 12, position_ned_m: [36, 0, -11] as [number, number, number], touched: 0 };
const OTHER = { name: '2', distance_m: 8, t_s: 5, position_ned_m: [9, 0, -10] as [number, number, number], touched: 0 };
const QUIET: Futures = {
  vehicle_id: '1',
  flights: 100,
  seed: 0,
  horizon_s: 20,
  command: 'goto',
  corridor: {
    t_s: [0, 10, 20],
    position_ned_m: [
      [0, 0, -10],
      [20, 0, -10],
      [40, 0, -12],
    ],
    horizontal_m: [1, 3, 2],
    vertical_m: [1, 1, 1],
  },
  target_ned_m: [40, 0, -12],
  arrived: 100,
  arrival_s: { p5: 11.2, p50: 13, p95: 15.4 },
  landed: 0,
  touched_ground: 0,
  lost_control: 0,
  battery_start_share: 0.8,
  battery_end_share: { p5: 0.75, p50: 0.76, p95: 0.77 },
  fence: FENCE,
  obstacle: null,
  vehicle: OTHER,
  spread: {} as Futures['spread'],
  assumed: [],
  state_unix_s: 1,
  origin: { lat_deg: 47, lon_deg: 8, alt_amsl_m: 400 },
  clear: true,
  limited: [],
  stopped: null,
};
const nameOf = (id: string): string => `Quad ${id}`;

describe('the texts of futures', () => {
  it('say time, battery and the nearest things of quiet flights', () => {
    const { dangers, facts } = futuresTexts(QUIET, nameOf);
    expect(dangers).toEqual([]);
    expect(facts).toBe('100 simulated flights: there in 11 to 15 s; battery 76 %; geofence 14.0 m after 12 s; Quad 2 8.0 m after 5 s.');
  });

  it('name what flights touch, and not twice', () => {
    const texts = futuresTexts(
      {
        ...QUIET,
        fence: { ...FENCE, touched: 37, distance_m: -3 },
        obstacle: { name: 'Tower', distance_m: 0, t_s: 8, position_ned_m: [30, 0, -10], touched: 4 },
        vehicle: { ...OTHER, touched: 1, distance_m: 1.5 },
        touched_ground: 2,
        lost_control: 1,
        stopped: 'it cannot stop inside',
        limited: ['speed 3 m/s'],
      },
      nameOf,
    );
    expect(texts.dangers).toEqual([
      'Loses control in 1 of 100 simulated flights.',
      'Touches the ground in 2 of 100 simulated flights.',
      'Leaves the geofence in 37 of 100 simulated flights, by up to 3.0 m, after 12 s.',
      'Touches Tower in 4 of 100 simulated flights, after 8 s.',
      'Comes within 1.5 m of Quad 2 in 1 of 100 simulated flights, after 5 s.',
      'The stream would stop: it cannot stop inside.',
    ]);
    expect(texts.facts).toBe('100 simulated flights: there in 11 to 15 s; battery 76 %; limited: speed 3 m/s.');
  });

  it('say when the end is not known', () => {
    expect(futuresTexts({ ...QUIET, arrival_s: null, arrived: 0 }, nameOf).facts).toContain('under way for more than 20 s');
    expect(futuresTexts({ ...QUIET, target_ned_m: null, arrival_s: null, arrived: 0 }, nameOf).facts).toContain('within 20 s');
    expect(futuresTexts({ ...QUIET, landed: 100 }, nameOf).facts).toContain('on the ground within 20 s');
  });
});

describe('the layer of futures', () => {
  const layerOf = (result: Futures): LayerContent => {
    const layer = futuresLayer(result);
    if (layer === null) throw new Error('no layer');
    return layer;
  };

  it('has the corridor, its mean and the place of its end', () => {
    const layer = layerOf(QUIET);
    expect(layer.lines.map(({ tone, style }) => `${tone} ${style}`)).toEqual(['target dashed', 'target dotted', 'target dotted']);
    expect(layer.lines[0]?.positions.at(-1)?.alt_amsl_m).toBeCloseTo(412);
    expect(layer.lines[1]?.positions.at(-1)?.alt_amsl_m).toBeCloseTo(413);
    expect(layer.areas).toHaveLength(2);
    expect(layer.points).toEqual([]);
  });

  it('is red where flights touch something', () => {
    const layer = layerOf({ ...QUIET, clear: false, fence: { ...FENCE, touched: 3 } });
    expect(new Set([...layer.lines, ...layer.areas].map(({ tone }) => tone))).toEqual(new Set(['danger']));
    expect(layer.points.map(({ id, mark, tone }) => [id, mark, tone])).toEqual([['geofence', 'cross', 'danger']]);
  });

  it('is nothing without a place', () => {
    expect(futuresLayer({ ...QUIET, origin: null })).toBeNull();
  });
});

describe('the futures of an open confirmation', () => {
  let requests: { path: string; init: RequestInit; answer: (status: number, body: unknown) => void }[];
  let futures: FuturesOfConfirmation;

  beforeEach(() => {
    vi.useFakeTimers();
    requests = [];
    const fetch = (path: string, init: RequestInit): Promise<Response> =>
      new Promise((resolve, reject) => {
        init.signal?.addEventListener('abort', () => reject(new Error('aborted')));
        const answer = (status: number, body: unknown): void =>
          resolve(new Response(JSON.stringify(body), { status, headers: { 'Content-Type': 'application/json' } }));
        requests.push({ path, init, answer });
      });
    futures = new FuturesOfConfirmation(new ApiClient('test', undefined, fetch));
  });
  afterEach(() => void vi.useRealTimers());

  const confirmationOf = (vehicle: string, alt_home_m = 10): { command: CommandToConfirm } => ({
    command: {
      name: 'Altitude',
      vehicles: [vehicle],
      vehicleNames: vehicle,
      send: () => Promise.reject(new Error('not sent')),
      texts: () => ({ title: '', effect: '', verb: '', danger: false }),
      futures: () => ({ altitude: { alt_home_m } }),
    },
  });
  const settle = (): Promise<unknown> => vi.advanceTimersByTimeAsync(0);

  it('are asked for at once, and again while it is open', async () => {
    futures.follow(confirmationOf('1'));
    await settle();
    expect(requests.map(({ path, init }) => [path, init.body])).toEqual([['/api/v1/vehicles/1/futures', '{"altitude":{"alt_home_m":10}}']]);
    expect(futures.state).toEqual({ kind: 'computing' });
    requests[0]?.answer(200, QUIET);
    await settle();
    expect(futures.state?.kind).toBe('known');
    expect(futures.layer()?.areas).toHaveLength(2);
    await vi.advanceTimersByTimeAsync(2000);
    expect(requests).toHaveLength(2);
  });

  it('end with the confirmation, also while they are computed', async () => {
    futures.follow(confirmationOf('1'));
    await settle();
    futures.follow(null);
    expect(requests[0]?.init.signal?.aborted).toBe(true);
    await vi.advanceTimersByTimeAsync(10_000);
    expect([requests.length, futures.state, futures.layer()]).toEqual([1, null, null]);
  });

  it('of another vehicle are never shown', async () => {
    futures.follow(confirmationOf('1'));
    await settle();
    futures.follow(confirmationOf('2'));
    await settle();
    requests[0]?.answer(200, QUIET);
    await settle();
    expect(futures.state).toEqual({ kind: 'computing' });
    expect(requests[1]?.path).toBe('/api/v1/vehicles/2/futures');
  });

  it('that are refused are no longer shown, but a busy server is asked again', async () => {
    futures.follow(confirmationOf('1'));
    await settle();
    requests[0]?.answer(200, QUIET);
    await vi.advanceTimersByTimeAsync(2000);
    requests[1]?.answer(429, { code: 'server_busy', detail: 'Busy.' });
    await settle();
    expect(futures.state?.kind).toBe('known');
    await vi.advanceTimersByTimeAsync(2000);
    requests[2]?.answer(409, { code: 'refused', detail: 'It has landed.' });
    await settle();
    expect(futures.state).toEqual({ kind: 'none', why: 'It has landed.' });
  });

  it('are not shown any more when the server stays too busy for newer ones', async () => {
    futures.follow(confirmationOf('1'));
    await settle();
    requests[0]?.answer(200, QUIET);
    for (let i = 1; i <= 4; i++) {
      await vi.advanceTimersByTimeAsync(2000);
      expect(futures.state?.kind).toBe('known');
      requests[i]?.answer(429, { code: 'server_busy', detail: 'Busy.' });
      await settle();
    }
    expect(futures.state).toEqual({ kind: 'none', why: 'Busy.' });
  });

  it('are none of a command without them', async () => {
    const { futures: _none, ...command } = confirmationOf('1').command;
    futures.follow({ command });
    await settle();
    expect([futures.state, requests.length]).toEqual([null, 0]);
  });
});
