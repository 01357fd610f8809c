import { describe, expect, it } from 'vitest';
import { positionAt } from '../../../vehicle/geo';
import { EMPTY_PLAN, type Plan } from '../document/document';
import { newItem } from '../document/items';
import { flownRuns, type FlownPath } from '../offboard/flown-path';
import { distanceLeftText, itemNames, missionLayer, offboardLayer } from './mission-in-fly';
import { continueTexts } from './mission-start';

const HOME = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const north = (north_m: number) => positionAt(HOME, { north_m, east_m: 0 });
const altitude = { value_m: 20, reference: 'home' } as const;
const PLAN: Plan = {
  ...EMPTY_PLAN,
  items: [
    newItem('takeoff', north(0), altitude),
    newItem('waypoint', north(100), altitude),
    newItem('roi_location', north(50), altitude),
    newItem('waypoint', north(200), altitude),
    { kind: 'return_home' },
  ],
};

describe('the mission on the map', () => {
  it('fades what was flown and shows the current item bright', () => {
    const { points, lines, ground } = missionLayer(PLAN, HOME, 3);
    expect(points.map(({ text, faded, selected }) => [text, faded === true, selected])).toEqual([
      ['1', true, false],
      ['2', true, false],
      ['', true, false],
      ['4', false, true],
    ]);
    expect(points[3]?.alt_amsl_m).toBe(500);
    expect(lines.map(({ positions, faded }) => [positions.length, faded === true])).toEqual([
      [2, true],
      [2, false],
    ]);
    expect(ground).toBe(HOME);
  });

  it('fades nothing while it is not flown, and has no 3D view without a home', () => {
    const { points, lines, ground } = missionLayer(PLAN, null, null);
    expect(points.every(({ faded, selected }) => faded !== true && !selected)).toBe(true);
    expect(lines).toHaveLength(1);
    expect(ground).toBeUndefined();
  });

  it('has the distances to the current and to the last item', () => {
    expect(distanceLeftText(PLAN, 1, north(0))).toBe('100 m to it · 200 m to the last item');
    expect(distanceLeftText(PLAN, 3, north(100))).toBe('100 m to it');
    expect(distanceLeftText(PLAN, 4, north(100))).toBeNull();
    expect(distanceLeftText(PLAN, 1, null)).toBeNull();
    const withJump = { ...PLAN, items: [...PLAN.items, { kind: 'jump' } as const] };
    expect(distanceLeftText(withJump, 1, north(0))).toBe('100 m to it');
  });

  it('names its items, by number alone while the plan is not read', () => {
    expect(itemNames(PLAN, 5)[1]).toBe('2 · Waypoint');
    expect(itemNames(null, 2)).toEqual(['1', '2']);
  });

  it('says what a skip leaves out and that a restart flies everything again', () => {
    const progress = { current: 1, count: 5 };
    expect(continueTexts('Quad 1', { does: 'skip', item: 3 }, progress).effect).toContain(
      'to item 4 of 5 and continues from there. It leaves out items 2 to 3.',
    );
    expect(continueTexts('Quad 1', { does: 'skip', item: 2 }, progress).effect).toContain('It leaves out item 2.');
    expect(continueTexts('Quad 1', { does: 'skip', item: 0 }, progress).effect).not.toContain('leaves out');
    expect(continueTexts('Quad 1', { does: 'restart', item: 0 }, progress)).toMatchObject({ title: 'Restart the mission of Quad 1', verb: 'Restart' });
    expect(continueTexts('Quad 1', { does: 'resume', item: null }, progress).effect).toContain('item 2 of 5 (current)');
  });
});

const leg = (place: string, ...points: number[][]) => ({ place, main: true, points });
const FLOWN = {
  origin: HOME,
  planned_by: 'mission',
  planned_legs: [leg('step 1', [0, 0, 0, -5], [1, 10, 0, -5]), leg('step 2', [1, 10, 0, -5], [2, 20, 0, -5]), leg('step 3', [2, 20, 0, -5], [3, 30, 0, -5])],
  samples: [],
} as unknown as FlownPath;

describe('an offboard mission on the map', () => {
  it('fades its flown steps and shows the current one bright', () => {
    const layer = offboardLayer(FLOWN, 'step 2');
    expect(layer?.points.map(({ text, faded, selected }) => [text, faded === true, selected])).toEqual([
      ['1', true, false],
      ['2', false, true],
      ['3', false, false],
    ]);
    expect(layer?.lines.map(({ faded }) => faded === true)).toEqual([true, false, false]);
    expect(layer?.points[0]?.alt_amsl_m).toBe(485);
    expect(offboardLayer({ ...FLOWN, origin: null }, 'step 2')).toBeNull();
  });
});

describe('a flown path', () => {
  it('has colours by its distance from the planned path', () => {
    const sample = (t_s: number, east_m: number) => ({ t_s, place: 'step 1', flown_ned_m: [t_s, east_m, -5], planned_ned_m: [t_s, 0, -5] });
    const path = { ...FLOWN, samples: [sample(0, 0), sample(1, 1), sample(2, 3), sample(3, 9), sample(4, 0)] } as unknown as FlownPath;
    expect(flownRuns(path).map(({ tone, points }) => [tone, points.length])).toEqual([
      ['actual', 2],
      ['caution', 2],
      ['danger', 2],
      ['actual', 2],
    ]);
  });
});
