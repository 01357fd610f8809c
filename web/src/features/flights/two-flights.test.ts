import { describe, expect, it, vi, beforeEach, afterEach } from 'vitest';
import { ApiClient } from '../../api/client';
import { labelOf } from '../../plots/sets';
import type { LogFile, Row } from './library.svelte';
import { LogView, type Overview } from './log-view.svelte';
import { secondLayer } from './track';
import { TwoFlights, type Comparison } from './two-flights.svelte';

const topic = (id: string, names: readonly string[]): Overview['topics'][number] => {
  const [name = '', instance = ''] = id.split(':');
  return { id, name, instance, samples: 2, begin_s: 0, end_s: 9, rate_hz: 1, fields: names.map((each) => ({ name: each, unit: null, type: 'float32' })) };
};
const overview = (topics: Overview['topics']): Overview => ({
  kind: 'ulog',
  start_unix_s: null,
  duration_s: 100,
  firmware: null,
  hardware: null,
  vehicles: [],
  flights: [],
  topics,
  parameters: [],
  parameter_changes: [],
  messages: [],
  messages_left_out: 0,
  dropouts: [],
  problems: [],
});
const POSITION = topic('vehicle_local_position:0', ['x', 'vx', 'vy']);
const GLOBAL = topic('vehicle_global_position:0', ['lat', 'lon', 'alt']);
const OWN = overview([POSITION, GLOBAL, topic('only_here:0', ['x'])]);
const totals = { duration_s: 60, distance_m: 100, height_m: 10, energy_wh: 5, charge_mah: 300, battery_used_share: null };
const compared = (offset_s: number): Comparison => ({
  align: 'arming',
  offset_s,
  first: totals,
  second: totals,
  shared_s: 60,
  t_s: [5, 6],
  distance_m: [1, 2],
  over_ground_m: [1, null],
  above_m: [0, 1],
  max_m: 2,
  max_s: 6,
  rms_m: 1.6,
  notes: [],
});
const FILE: LogFile = {
  id: 'f2',
  name: 'b.ulg',
  source: 'file',
  kind: 'ulog',
  bytes: 1,
  added_unix_s: 5,
  start_unix_s: null,
  duration_s: 61,
  vehicles: [],
  firmware: null,
  problem: null,
  running: false,
  read: true,
};
const ROW: Row = { id: 'f2', flight: null, files: [FILE] };
const PROBLEM = { type: 'about:blank', title: 'Invalid request', detail: 'In the second log the vehicle was not armed.', status: 422, code: 'invalid_request' };

describe('two flights over each other', () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  async function opened(beside: (query: URLSearchParams) => [number, unknown] = () => [200, compared(-20)]) {
    const asked: URL[] = [];
    const api = new ApiClient('test', undefined, (path, { method }) => {
      expect(method).toBe('GET');
      const url = new URL(path, 'http://test');
      asked.push(url);
      if (url.pathname.endsWith('/beside')) {
        const [status, value] = beside(url.searchParams);
        return Promise.resolve(Response.json(value, { status }));
      }
      if (!url.pathname.endsWith('/series')) return Promise.resolve(Response.json(url.pathname.endsWith('/f2') ? overview([POSITION, GLOBAL]) : OWN));
      const series = url.searchParams.getAll('field').map((field) => ({ field, unit: null, samples: 2, t_s: [30, 40], values: [47, 47.001] }));
      return Promise.resolve(Response.json({ series }));
    });
    const view = new LogView(api);
    await view.open('f1', 'a.ulg');
    return { view, two: new TwoFlights(api, view), asked };
  }

  it('draws each field of both at the times of the open one, and how far apart they are', async () => {
    const { view, two, asked } = await opened();
    view.showPanes([
      { fields: ['vehicle_local_position:0/x', 'only_here:0/x'] },
      { fields: ['norm({vehicle_local_position:0/vx}, {vehicle_local_position:0/vy})'] },
    ]);
    await two.choose(ROW);
    expect(asked.find(({ pathname }) => pathname.endsWith('/beside'))?.search).toBe('?other=f2&align=arming');
    await vi.advanceTimersByTimeAsync(100);
    expect(view.panes.map(({ fields }) => fields.map(labelOf))).toEqual([
      ['Distance of the flights', 'Distance over ground', 'Second flight higher by'],
      ['vehicle_local_position x', 'only_here x'],
      ['norm({vehicle_local_position/vx}, {vehicle_local_position/vy})'],
    ]);
    expect(view.beside('only_here:0/x')).toBeNull();
    const other = view.beside('vehicle_local_position:0/x') ?? '';
    expect([labelOf(other), view.series.get(other)?.t_s]).toEqual(['vehicle_local_position x', [10, 20]]);
    const values = asked.filter(({ pathname }) => pathname.endsWith('/f2/series')).at(-1)?.searchParams;
    expect(values?.getAll('field')).toEqual(['vehicle_local_position:0/x', 'norm({vehicle_local_position:0/vx}, {vehicle_local_position:0/vy})']);
    expect([values?.get('from_s'), values?.get('to_s')]).toEqual(['20', '120']);
    view.cursor_s = 15;
    expect(two.layer()?.points[0]).toMatchObject({ id: 'second', tone: 'id2', lat_deg: expect.closeTo(47.0005, 4) as number });
    expect(two.layer()?.ground).toEqual(secondLayer(view.track, null, view.track)?.ground);
  });

  it('moves the second flight by another offset without changing the panes', async () => {
    const { view, two, asked } = await opened((query) => [200, compared(Number(query.get('offset_s') ?? -20))]);
    await two.choose(ROW);
    view.showPanes([{ fields: ['vehicle_local_position:0/vx'] }]);
    await two.alignBy('offset');
    expect(two.offset).toBe('-20');
    two.offset = '-7.5';
    await two.compare();
    await vi.advanceTimersByTimeAsync(100);
    expect(asked.filter(({ pathname }) => pathname.endsWith('/beside')).at(-1)?.search).toBe('?other=f2&align=offset&offset_s=-7.5');
    expect(view.panes.map(({ fields }) => [...fields])).toEqual([['vehicle_local_position:0/vx']]);
    expect(view.series.get(view.beside('vehicle_local_position:0/vx') ?? '')?.t_s).toEqual([22.5, 32.5]);
    two.offset = 'abc';
    const before = asked.length;
    await two.compare();
    expect([two.offset_s, asked.length]).toEqual([null, before]);
  });

  it('says why two flights cannot be compared, and another way is tried with the same flight', async () => {
    const { view, two } = await opened((query) => (query.get('align') === 'fit' ? [200, compared(3)] : [422, PROBLEM]));
    await two.choose(ROW);
    expect([two.problem?.detail, view.second, two.isBusy]).toEqual([PROBLEM.detail, null, false]);
    await two.alignBy('fit');
    expect([two.problem, view.second?.offset_s]).toEqual([null, 3]);
  });

  it('ends with the open flight, and does not offer it as the second one', async () => {
    const { view, two } = await opened();
    const choosing = two.choose(ROW);
    await view.open('f3', 'c.ulg');
    two.reset();
    await choosing;
    expect([view.second, two.result, two.layer()]).toEqual([null, null, null]);
    expect(two.others([ROW, { ...ROW, id: 'f3' }, { ...ROW, id: 'n1', files: [] }])).toEqual([ROW]);
  });
});
