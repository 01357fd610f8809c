import { beforeEach, expect, it, vi } from 'vitest';
import type { ApiClient } from '../../api/client';
import { groundCalls, mapCalls, type MapRegion, type MapSource } from './source-calls';
import { isWmtsDescription, TileSources, whoLearns, whoLearnsOfGround } from './tile-sources.svelte';

const OWN: MapSource = {
  id: 'own1',
  name: 'Field',
  url: 'http://10.0.0.2/{z}/{x}/{y}',
  host: '10.0.0.2',
  attribution: '',
  min_zoom: 0,
  max_zoom: 19,
  may_save: true,
  own: true,
  kept_bytes: 0,
  problem: null,
};
const REGION = { source: 'own1', name: 'x', bounds_deg: [8, 47, 8.1, 47.1] as [number, number, number, number], min_zoom: 8, max_zoom: 12 };
const RUNNING = { id: '7', state: 'running', error: null };

let calls: [string, string, unknown][] = [];
let answers: Record<string, unknown[]> = {};
const call =
  (method: string) =>
  (path: string, init?: { body?: unknown }): Promise<unknown> => {
    calls.push([method, path, init?.body]);
    const value = answers[`${method} ${path}`]?.shift();
    const failed = value !== undefined && (value as { title?: string }).title !== undefined;
    return Promise.resolve(failed ? { ok: false, problem: value } : { ok: true, value });
  };
const api = { get: call('GET'), post: call('POST'), put: call('PUT'), delete: call('DELETE') } as unknown as ApiClient;
let sources: TileSources<MapRegion>;

beforeEach(() => {
  vi.useFakeTimers();
  [calls, answers] = [[], {}];
  sources = new TileSources(api, mapCalls(api), 'map');
});

it('says who learns what, before a source is chosen and after', () => {
  expect(whoLearns(null)).toContain('nothing is asked for');
  expect(whoLearns(OWN)).toContain('10.0.0.2');
  expect(whoLearnsOfGround(null)).toContain('nothing is asked for');
  expect(whoLearnsOfGround(OWN)).toContain('When you save an area, the server asks 10.0.0.2');
});

it('shows an added source at once, and nothing if the address is refused', async () => {
  answers = {
    'POST /map_sources': [{ title: 'Invalid request', detail: 'names no tile' }, OWN],
    'PUT /map_sources/chosen': [{ chosen: 'own1', sources: [OWN] }],
  };
  const draft = { name: 'Field', url: 'http://10.0.0.2/', attribution: '', may_save: true };
  expect(await sources.add(draft)).toBe(false);
  expect(sources.problem?.detail).toBe('names no tile');
  expect(await sources.add(draft)).toBe(true);
  expect(sources.problem).toBeNull();
  expect(sources.chosen?.id).toBe('own1');
});

it('asks a service for its layers, of which one is added with its own zooms', async () => {
  const layer = { name: 'Aerial', url: 'http://10.0.0.2/a/{z}/{y}/{x}', min_zoom: 6, max_zoom: 17 };
  answers = {
    'POST /map_sources/wmts_layers': [
      { title: 'Invalid request', detail: 'a web page' },
      { attribution: 'Us', layers: [layer], others: 2 },
    ],
    'POST /map_sources': [OWN],
  };
  const url = 'http://10.0.0.2/WMTSCapabilities.xml';
  await sources.readLayers(url);
  expect([sources.service, sources.problem?.detail, sources.isService(url)]).toEqual([null, 'a web page', true]);
  await sources.readLayers(url);
  expect([sources.service?.others, sources.problem, sources.isService(url)]).toEqual([2, null, false]);
  await sources.add({ ...layer, attribution: 'Us', may_save: false });
  expect(calls.find(([, path]) => path === '/map_sources')?.[2]).toEqual({ ...layer, attribution: 'Us', may_save: false });
  expect(new TileSources(api, groundCalls(api), 'ground').isService(url)).toBe(false);
});

it.each([
  ['https://a.example/wmts/1.0.0/WMTSCapabilities.xml', true],
  ['https://a.example/geo/wmts?SERVICE=WMTS&REQUEST=GetCapabilities', true],
  ['https://a.example/ows?service=wmts&key=1', true],
  [' https://a.example/gwc/service/wmts ', true],
  ['https://a.example/wmts?SERVICE=WMTS&REQUEST=GetTile&TileMatrix=1', false],
  ['https://a.example/wmts/l/{TileMatrix}/{TileRow}/{TileCol}.png', false],
  ['https://a.example/world.pmtiles', false],
])('knows the address of a description: %s', (url, expected) => {
  expect(isWmtsDescription(url)).toBe(expected);
});

it('saves exactly the area whose size it has shown', async () => {
  await sources.measure(null);
  expect(sources.problem?.detail).toContain('Make it large');
  await sources.save('Field');
  expect(calls).toEqual([]);
  answers = {
    'POST /map_regions/size': [{ tiles: 5, estimated_bytes: 100 }],
    'POST /map_regions': [RUNNING],
    'GET /operations/{o}': [RUNNING, { ...RUNNING, state: 'succeeded' }],
  };
  await sources.measure(REGION);
  expect(sources.measured?.tiles).toBe(5);
  const saving = sources.save('Test field');
  await vi.advanceTimersByTimeAsync(1000);
  await saving;
  expect(calls[1]).toEqual(['POST', '/map_regions', { ...REGION, name: 'Test field' }]);
  expect(sources.measured).toBeNull();
});

it('shows why saving ended, and changes nothing', async () => {
  const error = { title: 'The map source does not answer', detail: 'Field gives no tiles' };
  answers = {
    'POST /map_regions/size': [{ tiles: 5, estimated_bytes: 100 }],
    'POST /map_regions': [RUNNING],
    'GET /operations/{o}': [{ ...RUNNING, state: 'failed', error }],
  };
  await sources.measure(REGION);
  const saving = sources.save('x');
  await vi.advanceTimersByTimeAsync(500);
  await saving;
  expect(sources.problem).toEqual(error);
});

it('reads the list again after a source was removed', async () => {
  answers = {
    'GET /map_sources': [
      { chosen: 'own1', sources: [OWN] },
      { chosen: null, sources: [] },
    ],
  };
  await sources.read();
  await sources.remove(OWN);
  expect(sources.sources).toEqual([]);
});

it('asks the sources of heights under their own addresses', async () => {
  answers = {
    'GET /elevation/sources': [{ chosen: 'own1', sources: [OWN] }],
    'POST /elevation/regions/size': [{ tiles: 4, estimated_bytes: 100 }],
    'POST /elevation/regions': [{ ...RUNNING, state: 'succeeded' }],
  };
  const ground = new TileSources(api, groundCalls(api), 'ground');
  await ground.read();
  expect(ground.chosen?.id).toBe('own1');
  const region = { source: 'own1', name: 'x', bounds_deg: REGION.bounds_deg, zoom: 13 };
  await ground.measure(region);
  await ground.save('Hill');
  expect(calls.at(-1)).toEqual(['POST', '/elevation/regions', { ...region, name: 'Hill' }]);
  expect(ground.saving?.state).toBe('succeeded');
});
