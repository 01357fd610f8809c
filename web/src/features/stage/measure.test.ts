import { describe, expect, it } from 'vitest';
import { positionAt } from '../../vehicle/geo';
import { areaText } from '../../ui/format';
import { legText, measured } from './measure';
import { MAX_MEASURED_POINTS, Measurement } from './measure.svelte';

const HERE = { lat_deg: 47.4, lon_deg: 8.5 };
const at = (north_m: number, east_m: number) => positionAt(HERE, { north_m, east_m });
const SQUARE = [at(0, 0), at(0, 40), at(30, 40), at(30, 0)];

describe('a measured line', () => {
  it('has length and bearing of each leg, and the whole length', () => {
    const { legs, total_m, area_m2 } = measured(SQUARE, false);
    expect(legs.map((leg) => [leg.name, legText(leg)])).toEqual([
      ['1 → 2', '40.0 m, 090°'],
      ['2 → 3', '30.0 m, 000°'],
      ['3 → 4', '40.0 m, 270°'],
    ]);
    expect(total_m).toBeCloseTo(110, 1);
    expect(area_m2).toBeNull();
  });
  it('has perimeter and area when it is closed, unless its sides cross', () => {
    const closed = measured(SQUARE, true);
    expect(closed.legs.at(-1)?.name).toBe('4 → 1');
    expect(closed.total_m).toBeCloseTo(140, 1);
    expect(closed.area_m2).toBeCloseTo(1200, 0);
    const [a = HERE, b = HERE, c = HERE, d = HERE] = SQUARE;
    expect(measured([a, c, b, d], true)).toMatchObject({ area_m2: null, sidesCross: true });
    expect(measured([a, b, c], true)).toMatchObject({ sidesCross: false });
  });
  it('has areas in a unit that fits', () => {
    expect([12.34, 1234, 56_789, 2_345_678].map(areaText)).toEqual(['12.3 m²', '1234 m²', '5.68 ha', '2.35 km²']);
  });
});

describe('measuring', () => {
  it('adds a point with each click, closes by a click on the first one, and moves and removes points', () => {
    const measurement = new Measurement();
    for (const point of SQUARE) expect(measurement.press(point)).toBe(true);
    expect(measurement.content.points.map(({ text, selected }) => [text, selected])).toEqual([
      ['1', false],
      ['2', false],
      ['3', false],
      ['4', true],
    ]);
    measurement.pick('measure:0');
    expect(measurement.closed).toBe(true);
    expect(measurement.content.areas.length).toBe(1);
    measurement.grab('measure:2');
    measurement.drag('measure:2', at(60, 40));
    measurement.drop(false);
    expect(measurement.points[2]).toEqual(SQUARE[2]);
    expect(measurement.remove()).toBe(true);
    expect(measurement.points).toEqual([SQUARE[0], SQUARE[1], SQUARE[3]]);
    expect(measurement.closed).toBe(true);
    measurement.remove();
    expect(measurement.closed).toBe(false);
    measurement.clear();
    expect([measurement.points.length, measurement.remove(), measurement.canClose]).toEqual([0, false, false]);
  });
  it('stops at a number of points that the list can show', () => {
    const measurement = new Measurement();
    for (let index = 0; index < MAX_MEASURED_POINTS + 5; index += 1) measurement.press(at(index, 0));
    expect(measurement.points.length).toBe(MAX_MEASURED_POINTS);
    expect(measurement.isFull).toBe(true);
  });
});
