import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../api/client';
import { LogView, type LogPart } from './log-view.svelte';
import { RERUN } from '../../plots/sets';
import { cellText, Values } from './values.svelte';

const TABLE = { topic: 'a:0', samples: 120, from_row: 0, columns: [{ name: 'x', unit: 'm', type: 'float32' }], t_s: [0], rows: [[1]] };

function opened(answer: (path: string) => { status: number; value: unknown } = () => ({ status: 200, value: TABLE })) {
  const sent: string[] = [];
  const saved: string[] = [];
  const api = new ApiClient('page', undefined, async (path) => {
    sent.push(path);
    const { status, value } = answer(path);
    return new Response(JSON.stringify(value), { status });
  });
  const view = new LogView(api);
  view.parts = ['main', 'other'].map((file, i) => ({ file, source: null, offset_s: 10 * i, overview: {} as LogPart['overview'] }));
  view.shown = { from_s: 20, to_s: 30 };
  return { sent, saved, view, values: new Values(api, view, (url) => void saved.push(url)) };
}

describe('values of a log', () => {
  it('shows the rows of a topic, also from a time of the plots on', async () => {
    const { sent, values } = opened();
    await values.choose(1, 'a:0');
    await values.load({ at_s: 25 });
    expect(sent.map((path) => path.replace('/api/v1/flights/', ''))).toEqual([
      'other/table?topic=a%3A0&rows=50&from_row=0',
      'other/table?topic=a%3A0&rows=50&at_s=15',
    ]);
    expect(values.table?.samples).toBe(120);
  });

  it('saves a file only when the server has begun to write it, and says why it does not', async () => {
    const refused = opened(() => ({ status: 422, value: { title: 'Invalid request', detail: 'Parquet needs a package.', code: 'invalid_request' } }));
    await refused.values.export({ format: 'parquet', topic: ['a:0'] });
    expect(refused.saved).toEqual([]);
    expect(refused.values.problem?.detail).toBe('Parquet needs a package.');
    expect(refused.values.asking).toBeNull();
    const { saved, values } = opened();
    await values.choose(1, 'a:0');
    values.onlyShown = true;
    await values.export({ format: 'csv', topic: ['a:0'] });
    expect(saved).toEqual(['/api/v1/flights/other/export?format=csv&topic=a%3A0&from_s=10&to_s=20']);
  });

  it('saves the plotted fields of the shown log', () => {
    const { values, view } = opened();
    view.panes = [{ id: 0, fields: ['a:0/x', '1|b:0/y', `${RERUN}North`] }];
    expect(values.plotted).toEqual(['a:0/x']);
    values.part = 1;
    expect(values.plotted).toEqual(['b:0/y']);
  });

  it('writes values as people read them', () => {
    expect([null, 0.1234567891, -3, 18446744073709, true, 'x'].map(cellText)).toEqual(['–', '0.1234568', '−3', '18446744073709', 'true', 'x']);
  });
});
