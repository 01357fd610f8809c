import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';
import { ApiClient } from '../api/client';
import type { components } from '../api/schema';
import { layoutOf, renamed, showLayout, withLayout, type Layout } from './layouts';
import { LiveBuffer, MAX_SAMPLES, thinned } from './live-buffer';
import { continued, LiveView, stateOf, topicsOf, type Received } from './live-view.svelte';
import { SETS } from './sets';
import { methodText, pixels, strongest_hz, type Spectrum } from './spectrum';

type Values = components['schemas']['LiveValues'];
const ROLL = 'ATTITUDE:1.1/roll';
const series = (field: string, t_s: number[], gap = false): Values['series'][number] => ({ field, unit: 'rad', gap, t_s, values: t_s });

describe('values that arrive', () => {
  it('are kept once, and what is missing is a gap', () => {
    const buffer = new LiveBuffer();
    buffer.add({ t_s: [1, 2], values: [10, 20] }, false);
    buffer.add({ t_s: [2, 3], values: [20, null] }, false);
    buffer.add({ t_s: [9], values: [90] }, true);
    expect(buffer.within(0, 10, 99)).toEqual({ t_s: [1, 2, 3, 3, 9], values: [10, 20, null, null, 90] });
    expect(buffer.within(2.5, 4, 99).t_s).toEqual([2, 3, 3, 9]);
    buffer.forgetBefore(3);
    expect(buffer.within(0, 10, 99).t_s).toEqual([3, 3, 9]);
  });

  it('are bounded in number, and keep their extremes', () => {
    const buffer = new LiveBuffer();
    for (let i = 0; i < 5; i += 1) {
      const t_s = Array.from({ length: MAX_SAMPLES / 2 }, (_, k) => (i * MAX_SAMPLES) / 2 + k);
      buffer.add({ t_s, values: t_s.map((t) => (t === 7777 ? 99 : t === 8888 ? -99 : Math.sin(t))) }, false);
    }
    const all = buffer.within(-1, 1e9, 1e9);
    expect(all.t_s.length).toBeLessThanOrEqual(MAX_SAMPLES);
    expect(all.t_s).toEqual([...all.t_s].sort((a, b) => a - b));
    expect(all.values).toContain(99);
    expect(all.values).toContain(-99);
    expect(all.t_s.at(-1)).toBe(2.5 * MAX_SAMPLES - 1);
  });

  it('are thinned to the extremes of each run, and a gap stays', () => {
    const values = [0, 5, 1, -3, 2, 2, null, 2];
    expect(thinned({ t_s: values.map((_, i) => i), values }, 4)).toEqual({ t_s: [1, 3, 4, 6], values: [5, -3, 2, null] });
    expect(thinned({ t_s: [1], values: [2] }, 4)).toEqual({ t_s: [1], values: [2] });
  });
});

describe('bands of a live plot', () => {
  it('continue while the state is the same, and end while it is not known', () => {
    let modes = continued([], 1, 'Hold');
    modes = continued(modes, 1.5, 'Hold');
    modes = continued(modes, 2, 'Return');
    modes = continued(modes, 2.5, null);
    modes = continued(modes, 9, 'Return');
    expect(modes).toEqual([
      { begin_s: 1, end_s: 1.5, name: 'Hold' },
      { begin_s: 2, end_s: 2, name: 'Return' },
      { begin_s: 9, end_s: 9, name: 'Return' },
    ]);
    expect(stateOf(null)).toBeNull();
  });
});

describe('the list of a vehicle’s messages', () => {
  it('has each number that can be plotted, of each instance, in the names of a telemetry log', () => {
    const message = { id: 1, component: 1, count: 3, rate_hz: 10, age_s: 0, size_bytes: 9, instance: null, instances: [] };
    const received: Received = {
      system: 4,
      since_s: 1,
      loss: [],
      left_out: 0,
      messages: [
        { ...message, name: 'ATTITUDE', fields: { roll: 1, q: [1, null], text: 'a' } },
        { ...message, name: 'BATTERY_STATUS', fields: { voltage: 1 }, instance: 0, instances: [0, 2] },
        { ...message, name: null, fields: null },
      ],
    };
    expect(topicsOf(received).map(({ id, fields }) => [id, fields.map(({ name }) => name)])).toEqual([
      ['ATTITUDE:4.1', ['roll', 'q[0]', 'q[1]']],
      ['BATTERY_STATUS:4.1.0', ['voltage']],
      ['BATTERY_STATUS:4.1.2', ['voltage']],
    ]);
    const view = new LiveView(new ApiClient('test', undefined, () => Promise.reject(new Error('offline'))));
    view.sources = [{ source: null, prefix: '', topics: topicsOf(received) }];
    expect(SETS.filter((set) => view.fieldsOf(set).length > 0).map(({ title }) => title)).toEqual(['Attitude']);
  });
});

describe('a live plot', () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  function opened(answer: (query: URLSearchParams) => [number, unknown]) {
    const asked: URLSearchParams[] = [];
    const api = new ApiClient('test', undefined, (path) => {
      const url = new URL(path, 'http://a');
      const isSeries = url.pathname.endsWith('/series');
      if (isSeries) asked.push(url.searchParams);
      const [status, body] = isSeries ? answer(url.searchParams) : [200, { system: 1, since_s: 0, messages: [], loss: [], left_out: 0 }];
      return Promise.resolve(new Response(JSON.stringify(body), { status, headers: { 'Content-Type': 'application/json' } }));
    });
    const view = new LiveView(api);
    view.open('1', 'One', [[ROLL]]);
    return { view, asked };
  }

  it('moves with the time, stands still while it is paused, and goes on', async () => {
    let now_s = 1000;
    const { view } = opened(() => [200, { now_s, after: now_s, more: false, series: [series(ROLL, [now_s])] }]);
    const stop = view.watch(() => ({ mode: 'Hold', armed: true, failsafe: false }));
    for (; now_s < 1100; now_s += 1) await vi.advanceTimersByTimeAsync(250);
    expect(view.shown).toEqual({ from_s: 99 - 60, to_s: 99 });
    expect(view.vehicles[0]?.armed).toEqual([{ begin_s: expect.any(Number), end_s: expect.any(Number), name: 'Armed' }]);
    view.zoom({ from_s: 10, to_s: 20 });
    for (; now_s < 1200; now_s += 1) await vi.advanceTimersByTimeAsync(250);
    expect([view.isPaused, view.shown]).toEqual([true, { from_s: 10, to_s: 20 }]);
    expect(view.series.get(ROLL)?.t_s.slice(0, 2)).toEqual([10, 11]);
    view.resume();
    expect([view.isPaused, view.shown.to_s]).toEqual([false, 199]);
    view.zoomBy(2);
    expect(view.shown).toEqual({ from_s: 199 - 120, to_s: 199 });
    stop();
  });

  it('asks for what it does not have, a field that is added for all that is kept, and reads on while there is more', async () => {
    let parts = 3;
    const { view, asked } = opened((query) => {
      parts -= 1;
      return [200, { now_s: 10, after: 50 - parts, more: parts > 0, series: query.getAll('field').map((field) => series(field, [])) }];
    });
    await view.read();
    expect(asked.map((query) => query.get('after'))).toEqual(['0', '48', '49']);
    parts = 1;
    view.toggle('ATTITUDE:1.1/yaw');
    await view.read();
    expect(asked.slice(3).map((query) => query.get('after'))).toEqual(['50', '0']);
    expect(asked[4]?.getAll('field')).toEqual(['ATTITUDE:1.1/yaw']);
  });

  it('names a field that the server does not have, and plots the others', async () => {
    const wrong = 'sin({X:1.1/y})';
    const { view } = opened((query) =>
      query.getAll('field').includes(wrong)
        ? [422, { title: 'Invalid', detail: 'No message X.', status: 422 }]
        : [200, { now_s: 10, after: 5, more: false, series: [series(ROLL, [9])] }],
    );
    view.toggle(wrong);
    await view.read();
    expect([...view.failed]).toEqual([[wrong, 'No message X.']]);
    await view.read();
    expect([view.problem, view.series.get(ROLL)?.samples]).toEqual([null, 1]);
    view.toggle(wrong);
    expect(view.failed.size).toBe(0);
  });

  it('begins anew when the server’s clock does', async () => {
    let now_s = 5000;
    const { view } = opened(() => [200, { now_s, after: 5, more: false, series: [series(ROLL, [now_s])] }]);
    await view.read();
    now_s = 5010;
    await view.read();
    expect(view.series.get(ROLL)?.t_s).toEqual([0, 10]);
    now_s = 3;
    await view.read();
    expect(view.series.get(ROLL)?.t_s).toEqual([0]);
  });
});

describe('the axis of a field', () => {
  const made = (): LiveView => {
    const view = new LiveView(new ApiClient('test', undefined, () => Promise.reject(new Error('offline'))));
    view.open('7', 'Seven', [['a:0/v', 'a:0/w', 'a:0/amps', 'a:0/none']]);
    const units = { v: 'V', w: 'V', amps: 'A', none: null };
    view.series = new Map(Object.entries(units).map(([name, unit]) => [`a:0/${name}`, { field: `a:0/${name}`, unit, samples: 1, t_s: [0], values: [1] }]));
    return view;
  };
  const right = (view: LiveView): readonly string[] => view.panes.flatMap((pane) => view.rightOf(pane));

  it('is at the right if its unit is not that of the first', () => {
    expect(right(made())).toEqual(['a:0/amps']);
  });

  it('is what a person chooses, also once fields are removed', () => {
    const view = made();
    const { activePane } = view;
    view.changeAxis(activePane, 'a:0/none');
    expect(right(view)).toEqual(['a:0/amps', 'a:0/none']);
    view.changeAxis(activePane, 'a:0/amps');
    expect(right(view)).toEqual(['a:0/none']);
    view.toggle('a:0/none');
    expect(right(view)).toEqual([]);
  });
});

describe('a saved layout', () => {
  const topic = (id: string, names: string[]) => ({
    ...{ id, name: id.split(':')[0] ?? '', instance: id.split(':')[1] ?? '', samples: 1, begin_s: 0, end_s: 1, rate_hz: 1 },
    fields: names.map((name) => ({ name, unit: null, type: '' })),
  });

  it('is of another vehicle or instance too, and names what is not there', () => {
    const view = new LiveView(new ApiClient('test', undefined, () => Promise.reject(new Error('offline'))));
    view.open('7', 'Seven');
    view.sources = [{ source: null, prefix: '', topics: [topic('ATTITUDE:7.1', ['roll', 'pitch']), topic('BATTERY_STATUS:7.1.0', ['x'])] }];
    const layout: Layout = {
      name: 'Mine',
      panes: [
        { fields: ['degrees({ATTITUDE:1.1/roll})', 'ATTITUDE:1.1/gone'], right_axis: ['degrees({ATTITUDE:1.1/roll})', 'ATTITUDE:1.1/gone'], spectrum: false },
        { fields: ['1|BATTERY_STATUS:7.1.0/x'], right_axis: null, spectrum: true },
        { fields: ['estimator_status:0/x'], spectrum: false },
      ],
      window_s: 120,
    };
    expect(showLayout(layout, view)).toEqual(['ATTITUDE:1.1 gone', 'estimator_status x']);
    expect(view.panes.map(({ fields }) => fields)).toEqual([['degrees({ATTITUDE:7.1/roll})'], ['BATTERY_STATUS:7.1.0/x']]);
    const panes = [
      { fields: ['degrees({ATTITUDE:7.1/roll})'], right_axis: ['degrees({ATTITUDE:7.1/roll})'], spectrum: false },
      { fields: ['BATTERY_STATUS:7.1.0/x'], right_axis: null, spectrum: false }, // in flight there are no spectra
    ];
    expect(layoutOf(' Two ', view)).toEqual({ name: 'Two', panes, window_s: 120 });
    expect(showLayout({ name: 'x', panes: [{ fields: ['nothing:0/here'], spectrum: false }], window_s: null }, view)).toEqual(['nothing here']);
    expect(view.panes).toHaveLength(2);
  });

  it('replaces one of its name, and gets a name that no other has', () => {
    const a: Layout = { name: 'a', panes: [], window_s: null };
    const b: Layout = { ...a, name: 'b' };
    expect(withLayout([a, b], { ...a, window_s: 5 })).toEqual([{ ...a, window_s: 5 }, b]);
    expect(withLayout([a], b)).toEqual([a, b]);
    expect(renamed([a, b], 'a', ' c ').map(({ name }) => name)).toEqual(['c', 'b']);
    expect(renamed([a, b], 'a', 'b')).toEqual([a, b]);
    expect(renamed([a, b], 'a', ' ')).toEqual([a, b]);
  });
});

describe('a spectrum', () => {
  const found: Spectrum = {
    ...{ field: 'a:0/x', unit: null, rate_hz: 100, segment_s: 2, segments: 4, gaps: 0, irregular: 0 },
    frequencies_hz: [0, 10, 20, 30, 40],
    density: [9, 9, 1, 5, 2],
    t_s: [1, 2, 8],
    decibels: [
      [0, -60, -60, 0],
      [0, -60, -60, -60],
      [0, -60, 0, -60],
    ],
  };

  it('says which frequency is strongest apart from drift, and what weakens it', () => {
    expect(strongest_hz(found)).toBe(30);
    expect(strongest_hz({ ...found, density: [1, 1, 0, 0, 0] })).toBeNull();
    expect(methodText(found)).toBe('4 segments of 2 s (Hann, half overlap; Welch), 100 samples a second, resolution 0.5 Hz.');
    expect(methodText({ ...found, gaps: 2, irregular: 0.126 })).toContain('2 gaps in the samples are left out. 13 % of the samples are uneven');
  });

  it('is drawn over the window, with high frequencies above and nothing where there are no values', () => {
    const [width, height] = [10, 4];
    const image = pixels(found, { from_s: 0, to_s: 10 }, width, height);
    const at = (x: number, y: number): number[] => [...image.slice(4 * (y * width + x), 4 * (y * width + x) + 4)];
    expect(at(0, 0)).toEqual([253, 231, 37, 255]);
    expect(at(0, 1)).toEqual([30, 20, 70, 255]);
    expect(at(8, 1)).toEqual([253, 231, 37, 255]);
    expect(at(5, 0)[3]).toBe(0);
  });
});
