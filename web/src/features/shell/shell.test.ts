import { beforeEach, expect, test } from 'vitest';
import type { ApiClient } from '../../api/client';
import type { Frame } from '../../live/wire';
import { ShellPanelState, type ShellOutput } from './panel.svelte';

/** The vehicle's whole output, of which the server keeps and sends parts. */
let all = '';
let reads: number[] = [];
let panel: ShellPanelState;

const api = {
  get: async (_path: string, { params }: { params: { query: { after: number } } }) => {
    reads.push(params.query.after);
    return { ok: true, value: { open: true, end: all.length, text: all.slice(params.query.after) } };
  },
} as unknown as ApiClient;

function frame(output: Partial<ShellOutput>, vehicle = '1'): Frame {
  return { type: 'samples', samples: [{ topic: 'shell', vehicle, value: { open: true, ...output } }] } as unknown as Frame;
}

/** The newest characters of the output, as the telemetry has them. */
const newest = (count: number): Frame => frame({ end: all.length, text: all.slice(-count) });

async function watch(vehicle = '1'): Promise<void> {
  panel.watch(api, vehicle, 'ws://test', () => undefined);
  await Promise.resolve();
  await Promise.resolve();
}

beforeEach(() => {
  [all, reads, panel] = ['help\npxh> ', [], new ShellPanelState()];
});

test('output is joined without doubling, however much of it a sample repeats', async () => {
  await watch();
  for (const count of [0, 3, 9, 1000]) {
    all += 'ver hw\npxh> ';
    panel.onFrame(api, newest(count + 12));
    panel.onFrame(api, newest(5));
    expect(panel.text).toBe(all);
  }
  expect(reads).toEqual([0]);
});

test('output that the telemetry skipped is read', async () => {
  await watch();
  const before = all.length;
  all += 'x'.repeat(9000);
  panel.onFrame(api, newest(4000));
  await Promise.resolve();
  await Promise.resolve();
  expect(reads).toEqual([0, before]);
  expect(panel.text).toBe(all);
});

test('of output that the server does not have any more, the rest is shown', async () => {
  await watch();
  all += 'x'.repeat(9000);
  const kept = all.length - 5000;
  const late = { ...api, get: async () => ({ ok: true, value: { open: true, end: all.length, text: all.slice(kept) } }) } as unknown as ApiClient;
  panel.onFrame(late, newest(4000));
  await Promise.resolve();
  await Promise.resolve();
  expect(panel.text).toBe(all.slice(kept));
});

test('a server that starts again begins a new output', async () => {
  await watch();
  panel.onFrame(api, frame({ end: 5, text: 'pxh> ' }));
  expect(panel.text).toBe('pxh> ');
});

test('output of another vehicle is not shown, nor the answer about the vehicle before', async () => {
  const first = panel.watch(api, '1', 'ws://test', () => undefined);
  all = 'two\n';
  await watch('2');
  first();
  panel.onFrame(api, frame({ end: 900, text: 'one' }, '1'));
  expect(panel.text).toBe('two\n');
});

test('earlier lines are recalled, newest first, and the empty line after them', async () => {
  const post = { ...api, post: async () => ({ ok: true, value: {} }) } as unknown as ApiClient;
  await watch();
  for (const line of ['help', 'ver hw', 'ver hw', '']) await panel.send(post, '1', line, false);
  expect([panel.recall(1), panel.recall(1), panel.recall(1), panel.recall(-1), panel.recall(-1)]).toEqual(['ver hw', 'help', 'help', 'ver hw', '']);
});

test('a refusal is shown for its vehicle only, until the next line', async () => {
  const problem = { title: 'Refused', detail: 'Vehicle 1 is armed', reasons: [], remedy: null, code: 'refused', status: 409, field: null };
  const refusing = { ...api, post: async () => ({ ok: false, problem }) } as unknown as ApiClient;
  await watch();
  expect(await panel.send(refusing, '1', 'reboot', false)).toBe(false);
  expect(panel.problemOf('1')).toEqual(problem);
  expect(panel.problemOf('2')).toBeNull();
});
