import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../api/client';
import type { Row } from './library.svelte';
import { atArming, beginOf, differences, ParamCompare } from './param-compare.svelte';

const OVERVIEW = {
  parameters: [
    { name: 'A', value: 1 },
    { name: 'B', value: 2 },
  ],
  parameter_changes: [
    { t_s: 5, name: 'A', value: 1.5 },
    { t_s: 50, name: 'B', value: 9 },
  ],
};
const FLIGHT = { id: 'f1-0', name: null, parts: [{ id: 'f1-0', file: 'f1', source: 'vehicle', offset_s: 0, begin_s: 20, end_s: 80, why: null }] };
const ROW = { id: 'f1-0', flight: FLIGHT, files: [{ id: 'f1', name: 'a.ulg', start_unix_s: null, added_unix_s: 5 }] } as unknown as Row;

const compareWith = (answers: Record<string, unknown>): ParamCompare =>
  new ParamCompare(
    new ApiClient('test', undefined, (path) => {
      const body = answers[String(path).replace('/api/v1', '')];
      return Promise.resolve(new Response(JSON.stringify(body ?? { title: 'Unknown', detail: String(path) }), { status: body === undefined ? 404 : 200 }));
    }),
  );

describe('the parameters of a flight', () => {
  it('beside a vehicle’s need these read: why they cannot be is said, and another choice meanwhile wins', async () => {
    const compare = compareWith({});
    expect(await compare.readVehicle('1')).toBe(false);
    expect([compare.problem?.title, compare.isBusy]).toEqual(['Unknown', false]);
    const late = compareWith({ '/vehicles/1/params/refresh': { complete: true } });
    const reading = late.readVehicle('1');
    late.reset();
    expect([await reading, late.problem]).toEqual([false, null]);
  });
  it('are those at arming: of its log with the changes before, or else what the server noted', () => {
    const part = { offset_s: 10, overview: OVERVIEW as never };
    expect(atArming([part], null, 20)).toEqual([
      { name: 'A', value: 1.5 },
      { name: 'B', value: 2 },
    ]);
    expect(atArming([], { parameters: [{ name: 'C', value: 3 }] } as never, 20)).toEqual([{ name: 'C', value: 3 }]);
    expect([beginOf(null), beginOf(FLIGHT as never)]).toEqual([0, 20]);
  });

  it('differ with the precision of the vehicle; a side that lacks one is named, of some defaults not', () => {
    const mine = [
      { name: 'A', value: 0.1 },
      { name: 'B', value: 2 },
      { name: 'C', value: 3 },
    ];
    const other = [
      { name: 'A', value: Math.fround(0.1) },
      { name: 'B', value: 4 },
      { name: 'D', value: 5 },
    ];
    expect(differences(mine, other)).toEqual({
      rows: [
        { name: 'B', mine: 2, other: 4 },
        { name: 'C', mine: 3, other: null },
        { name: 'D', mine: null, other: 5 },
      ],
      same: 1,
    });
    expect(differences(mine, other, true)).toEqual({ rows: [{ name: 'B', mine: 2, other: 4 }], same: 1 });
  });

  it('are compared with another flight, and with defaults that a vehicle must have told', async () => {
    const compare = compareWith({
      '/flights/f1-0/joined': { parameters: [] },
      '/flights/f1': OVERVIEW,
      '/vehicles/1/params': {
        params: [
          { name: 'A', facts: { default: 1 } },
          { name: 'B', facts: null },
        ],
      },
      '/vehicles/2/params': { params: [] },
    });
    const mine = [
      { name: 'A', value: 1 },
      { name: 'B', value: 2 },
    ];
    await compare.withFlight(mine, ROW);
    expect(compare.comparison?.rows).toEqual([{ name: 'A', mine: 1, other: 1.5 }]);
    await compare.withDefaults(mine, '1', 'Quad');
    expect([compare.comparison?.rows, compare.comparison?.same]).toEqual([[], 1]);
    await compare.withDefaults(mine, '2', 'Other');
    expect([compare.comparison, compare.problem?.title]).toEqual([null, 'Not known']);
  });
});
