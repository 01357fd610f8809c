import { describe, expect, it } from 'vitest';
import { positionAt } from '../../../vehicle/geo';
import { ClosedCards } from '../flight/closed-cards.svelte';
import type { DryRunResult } from '../dry-run/dry-run.svelte';
import { distanceText, figures, flownLength_m, flownPathLayer, flownPlot, pathDistances, sourceText, type FlownPath } from './flown-path';

type Vector = [number, number, number];
type Sample = FlownPath['samples'][number];
type Leg = FlownPath['planned_legs'][number];

const ORIGIN = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const leg = (place: string, from: Vector, to: Vector, main = true): Leg => ({
  place,
  title: place,
  start_s: 0,
  duration_s: 10,
  main,
  role: null,
  points: [
    [0, ...from],
    [10, ...to],
  ],
});
const sample = (t_s: number, place: string, flown_ned_m: Vector, planned_ned_m: Vector | null): Sample => ({
  t_s,
  place,
  flown_ned_m,
  planned_ned_m,
  deviation_m: null,
  outside_corridor_m: null,
});
/** PX4 climbs 10 m; the vehicle flies 20 m north, then 20 m south along a line 4 m to the east; PX4 lands. */
const FLOWN: FlownPath = {
  name: 'Line',
  started_unix_s: 100,
  over: true,
  duration_s: 75,
  planned_duration_s: 65,
  planned_length_m: 64,
  planned_by: 'mission',
  planned_legs: [
    leg('step 1', [0, 0, 0], [0, 0, -10]),
    leg('step 2', [0, 0, -10], [20, 0, -10]),
    leg('step 3', [20, 4, -10], [0, 4, -10]),
    leg('step 4', [0, 4, -10], [0, 4, 0]),
  ],
  origin: ORIGIN,
  battery_start_share: 0.82,
  battery_end_share: 0.7,
  samples: [
    sample(0, 'step 1', [0, 0, -1], null),
    sample(10, 'step 1', [1, 0, -11], null),
    sample(15, 'step 2', [5, 3, -11], [6, 0, -10]),
    sample(20, 'step 2', [19, 0, -12], [20, 0, -10]),
    sample(30, 'step 3', [10, 4, -11], [8, 4, -10]),
    sample(40, 'step 4', [0, 4, -1], null),
  ],
  deviation_mean_m: 2,
  deviation_max_m: 3.3,
};

describe('distance from the planned path', () => {
  it('is measured to the path of the current step, only for samples with a planned position', () => {
    expect(pathDistances(FLOWN).map(({ t_s, distance_m }) => [t_s, Number(distance_m.toFixed(2))])).toEqual([
      [15, 3.16], // not 1.41 m, which is the distance from the path of step 3
      [20, 2],
      [30, 1],
    ]);
  });

  it('is measured to the whole path if the step has no path', () => {
    expect(pathDistances({ ...FLOWN, samples: [sample(1, 'step 9', [10, 3, -10], [10, 3, -10])] })[0]?.distance_m).toBeCloseTo(1);
    expect(pathDistances({ ...FLOWN, planned_legs: [] })).toEqual([]);
  });

  it('is stated as its maximum and its 95th percentile', () => {
    const distances = Array.from({ length: 100 }, (_, i) => ({ t_s: i, distance_m: i / 10 }));
    expect(distanceText(figures(FLOWN, distances, null), FLOWN)).toBe('Distance from the planned path: at most 9.9 m; 95 % within 9.4 m.');
    expect(distanceText(figures(FLOWN, [], null), FLOWN)).toContain('not known, because the server sent no position setpoints');
  });
});

describe('figures', () => {
  const row = (name: string, dryRun: DryRunResult | null, flown = FLOWN) => {
    const figure = figures(flown, [], dryRun).rows.find((candidate) => candidate.name === name);
    return [figure?.planned, figure?.flown];
  };
  const nominal = { battery_start_share: 0.8, battery_end_share: 0.69 };

  it('show the planned and the flown values', () => {
    expect(row('Time with setpoints', null)).toEqual(['1 min 05 s', '1 min 15 s']);
    expect(row('Length', null)).toEqual(['64.0 m', '53.4 m']);
    expect(row('Battery used', null)).toEqual(['not known', '12 %']);
    expect(row('Battery used', null, { ...FLOWN, battery_start_share: null })).toEqual(['not known', 'not known']);
  });

  it('depend on what the flight is compared with', () => {
    const waypointPlan: FlownPath = { ...FLOWN, planned_by: 'plan', planned_duration_s: null, planned_length_m: null };
    expect(sourceText(FLOWN)).toContain('without take-off and landing');
    expect(sourceText(waypointPlan)).toContain('straight lines between the items');
    expect(row('Time armed', null, waypointPlan)).toEqual(['–', '1 min 15 s']);
    expect(row('Length', null, waypointPlan)[0]).toBe('not known');
    expect(distanceText(figures(waypointPlan, [], null), waypointPlan)).toContain('no planned path is known for this flight');
  });

  it('have the planned battery use of a dry run with one vehicle', () => {
    expect(row('Battery used', { nominal, group: null } as unknown as DryRunResult)[0]).toBe('11 %');
    expect(row('Battery used', { nominal, group: { roles: {} } } as unknown as DryRunResult)[0]).toBe('not known');
  });

  it('have a length without the noise of the position estimate', () => {
    const hovering = Array.from({ length: 200 }, (_, i) => sample(i, 'step 2', [0.1 * (i % 2), 0, -10], null));
    expect(flownLength_m(hovering)).toBe(0);
  });
});

describe('plot', () => {
  it('shows the distance from the path over time', () => {
    const plot = flownPlot(FLOWN, pathDistances(FLOWN), 'distance');
    expect([plot?.trace.end_s, plot?.trace.top, plot?.trace.bottom, plot?.plannedParts]).toEqual([40, 4, 0, []]);
    expect(flownPlot(FLOWN, [], 'distance')).toBeNull();
  });

  it('shows the flown and the planned altitude above the start', () => {
    const plot = flownPlot(FLOWN, [], 'altitude');
    expect(plot?.trace.points.map(([, up_m]) => up_m)).toEqual([0, 10, 10, 11, 10, 0]);
    expect(plot?.plannedParts).toEqual([
      [
        [15, 9],
        [20, 9],
        [30, 9],
      ],
    ]);
    expect(flownPlot({ ...FLOWN, samples: [] }, [], 'altitude')).toBeNull();
  });
});

describe('map', () => {
  it('shows the planned path dashed and the flown path solid, in another colour where it is far from the plan', () => {
    const lines = flownPathLayer(FLOWN)?.lines ?? [];
    expect(lines.map(({ tone, style, positions }) => [tone, style, positions.length])).toEqual([
      ['target', 'dashed', 3],
      ['target', 'dashed', 3],
      ['actual', 'solid', 2],
      ['caution', 'solid', 2],
      ['actual', 'solid', 4],
    ]);
    expect(lines[1]?.positions[0]).toEqual(positionAt(ORIGIN, { north_m: 20, east_m: 4 }));
  });

  it('shows a branch only if it is the longest or was flown', () => {
    const pictureWithBranch = (flown: FlownPath) =>
      flownPathLayer({ ...flown, planned_legs: [leg('step 2', [0, 0, 0], [9, 0, 0]), leg('step 3', [9, 9, 0], [9, 0, 0], false)] })?.lines.filter(
        ({ tone }) => tone === 'target',
      );
    expect(pictureWithBranch(FLOWN)).toHaveLength(2);
    expect(pictureWithBranch({ ...FLOWN, samples: FLOWN.samples.filter(({ place }) => place !== 'step 3') })).toHaveLength(1);
  });

  it('shows nothing while the origin is not known', () => {
    expect(flownPathLayer({ ...FLOWN, origin: null })).toBeNull();
  });
});

it('a closed card stays closed after a reload, until the next flight', () => {
  const stored = new Map<string, string>();
  const storage = { getItem: (key: string) => stored.get(key) ?? null, setItem: (key: string, value: string) => void stored.set(key, value) };
  const cards = new ClosedCards(storage);
  expect(cards.isClosed('offboard', '1', 100)).toBe(false);
  cards.close('offboard', '1', 100);
  expect([cards.isClosed('offboard', '1', 100), cards.isClosed('offboard', '2', 100)]).toEqual([true, false]);
  const reloadedCards = new ClosedCards(storage);
  expect([reloadedCards.isClosed('waypoints', '1', 100), reloadedCards.isClosed('offboard', '1', 100), reloadedCards.isClosed('offboard', '1', 200)]).toEqual([
    false,
    true,
    false,
  ]);
});
