import { describe, expect, it } from 'vitest';
import type { FieldSource, Series } from '../../plots/plot-view.svelte';
import { positionOn, rerunLayer, timeAt, trackFields, trackLayer, trackOf } from './track';

const source = (prefix: string, id: string, fields: readonly string[]): FieldSource => {
  const named = fields.map((name) => ({ name, unit: null, type: 'float64' }));
  const [name = '', instance = ''] = id.split(':');
  return { source: 'recording', prefix, topics: [{ id, name, instance, samples: 2, begin_s: 0, end_s: 1, rate_hz: 1, fields: named }] };
};
const series = (t_s: readonly number[], values: readonly (number | null)[]): Series => ({
  field: 'x',
  unit: null,
  samples: t_s.length,
  t_s: [...t_s],
  values: [...values],
});

describe('the flown path of a log', () => {
  it('is of the first part that has positions', () => {
    expect(trackFields([source('', 'battery_status:0', ['voltage_v'])])).toBeNull();
    const position = source('1|', 'GLOBAL_POSITION_INT:7.1', ['lat', 'lon', 'alt', 'hdg']);
    expect(trackFields([source('', 'battery_status:0', ['voltage_v']), position])?.[0]).toBe('1|{GLOBAL_POSITION_INT:7.1/lat} * 0.0000001');
    expect(trackFields([source('', 'vehicle_global_position:0', ['lat', 'lon', 'alt'])])?.[1]).toBe('vehicle_global_position:0/lon');
  });

  it('has the vehicle at the cursor, between its points', () => {
    const track = trackOf([series([0, 5, 10], [47, 47.5, 48]), series([0, 10], [8, 9]), series([0, 10], [480, 500]), series([0, 4], [10, 90])]);
    expect(positionOn(track, 5)).toEqual({ t_s: 5, lat_deg: expect.closeTo(47.5, 6), lon_deg: expect.closeTo(8.5, 6), alt_amsl_m: expect.closeTo(490, 6) });
    expect([positionOn(track, -1), positionOn(track, 11)]).toEqual([null, null]);
    const layer = trackLayer(track, 5, null);
    expect(layer?.points[0]).toMatchObject({ mark: 'vehicle', yaw_deg: 90 });
    expect(layer?.ground?.alt_amsl_m).toBe(480);
    expect(trackLayer(track, null, null)?.points).toEqual([]);
  });

  it('is found by a place beside it, between its points', () => {
    const track = trackOf([series([0, 10], [47, 47.01]), series([0, 10], [8, 8]), series([0, 10], [480, 480]), undefined]);
    expect(timeAt(track, { lat_deg: 47.005, lon_deg: 8.0001 }, 10)).toBeCloseTo(5, 2);
    expect(timeAt(track, { lat_deg: 47.005, lon_deg: 8.001 }, 10)).toBeNull();
    expect(timeAt({ points: [], yaw: undefined }, { lat_deg: 47, lon_deg: 8 }, 10)).toBeNull();
  });

  it('has the parts that were far from the plan in the colours of Fly', () => {
    const track = trackOf([series([0, 10], [47, 48]), series([0, 10], [8, 9]), series([0, 10], [480, 500]), undefined]);
    const deviations = [0, 3, 3, 6, 1, null, 7];
    const samples = deviations.map((deviation_m, i) => ({ t_s: i, flown_ned_m: [i, 0, 0], deviation_m }));
    const record = { plan: { flown: { origin: { lat_deg: 47, lon_deg: 8, alt_amsl_m: 400 }, planned_legs: [], samples } } } as never;
    const lines = trackLayer(track, null, record)?.lines ?? [];
    expect(lines.map(({ tone, positions }) => [tone, positions.length])).toEqual([
      ['actual', 1500],
      ['caution', 3],
      ['danger', 2],
      ['danger', 2],
    ]);
  });

  it('has the paths of a rerun beside it, from where it was then', () => {
    const track = trackOf([series([0, 10], [47, 47]), series([0, 10], [8, 8]), series([0, 10], [480, 500]), undefined]);
    const path = { t_s: [5, 6], position_ned_m: [[100, 10, -20], [111, 10, -25]], tone: 'id2', id: 'unchanged' } as const; // prettier-ignore
    const layer = rerunLayer(track, [100, 10, -20], [path], 6);
    const [first, last] = layer?.lines[0]?.positions ?? [];
    expect(first).toMatchObject({ lat_deg: expect.closeTo(47, 9), lon_deg: expect.closeTo(8, 9), alt_amsl_m: expect.closeTo(490, 6) });
    expect(last).toMatchObject({ lat_deg: expect.closeTo(47.0000989, 5), alt_amsl_m: expect.closeTo(495, 6) });
    expect(layer?.points).toMatchObject([{ id: 'unchanged', tone: 'id2', alt_amsl_m: expect.closeTo(495, 6) }]);
    expect(rerunLayer(track, [100, 10, -20], [path], 7)?.points).toEqual([]);
    expect([rerunLayer(null, [0, 0, 0], [path], 6), rerunLayer(track, undefined, [path], 6), rerunLayer(track, [0, 0, 0], [], 6)]).toEqual([null, null, null]);
  });

  it('leaves out what is no position', () => {
    const track = trackOf([series([0, 1, 1.001, 10], [0, 0, 47, 47]), series([0, 1, 1.001, 10], [0, 0, 8, 8]), series([0, 10], [0, 480]), undefined]);
    expect(track.points.every(({ lat_deg }) => lat_deg > 40)).toBe(true);
    expect(trackLayer(trackOf([undefined, undefined, undefined, undefined]), 1, null)).toBeNull();
  });
});
