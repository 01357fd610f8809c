import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../api/client';
import { groundDistance_m, placeAt } from '../../vehicle/geo';
import { EMPTY } from './document';
import { DryRun, windOf, type DryRunView } from './dry-run.svelte';
import { dryRunPicture, ghostAt, resultLines } from './ghost';

const ORIGIN = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const VIEW = {
  nominal: {
    origin: ORIGIN,
    finished: true,
    duration_s: 65,
    length_m: 120,
    battery_start_share: 1,
    battery_end_share: 0.81,
    fence_distance_m: null,
    path: {
      t_s: [0, 10, 20],
      position_ned_m: [
        [0, 0, 0],
        [0, 0, -10],
        [100, 0, -10],
      ],
      velocity_ned_m_s: [
        [0, 0, 0],
        [3, 0, -4],
        [0, 0, 0],
      ],
      step: [0, 1, -1],
      step_places: ['step 1', 'step 2'],
    },
  },
  monte_carlo: null,
} as unknown as DryRunView;
const MANY = {
  ...VIEW,
  monte_carlo: {
    flights: [{}, {}],
    corridor: { position_ned_m: VIEW.nominal.path?.position_ned_m, horizontal_m: { p95: [1, 1, 2] } },
    duration_s: { p5: 60, p95: 70 },
    battery_end_share: { p5: 0.7 },
  },
} as unknown as DryRunView;

describe('a dry run', () => {
  it('shows where the vehicle is between two samples, and stays at its ends', () => {
    const ghost = ghostAt(VIEW, 15);
    expect(groundDistance_m(ghost ?? ORIGIN, placeAt(ORIGIN, { north_m: 50, east_m: 0 }))).toBeLessThan(0.01);
    expect(ghost).toMatchObject({ up_m: 10, speed_m_s: 5, step: 'step 2' });
    expect(ghostAt(VIEW, 99)).toMatchObject({ up_m: 10, step: '' });
    expect(ghostAt(VIEW, -1)).toMatchObject({ up_m: 0, step: 'step 1' });
    expect(ghostAt({ nominal: { ...VIEW.nominal, path: null } } as DryRunView, 1)).toBeNull();
  });

  it('draws its path, its ghost and the corridor of many flights', () => {
    const shown = dryRunPicture(MANY, 20);
    expect(shown.lines[0]?.places).toHaveLength(3);
    expect(shown.points).toMatchObject([{ id: 'ghost', selected: true }]);
    const [ring] = shown.areas;
    expect(ring?.ring).toHaveLength(4);
    expect(groundDistance_m(ring?.ring[1] ?? ORIGIN, placeAt(ORIGIN, { north_m: 100, east_m: 0 }))).toBeCloseTo(2, 1);
    expect(dryRunPicture(VIEW, 0).areas).toEqual([]);
  });

  it('says its result in numbers', () => {
    expect(resultLines(VIEW)).toEqual(['Flown: 01:05, 120 m, battery 100 % → 81 %.']);
    expect(resultLines(MANY)[1]).toBe('2 flights: 95 % within 2.0 m of the path, 01:00 to 01:10, battery at the end 70 % or more.');
  });

  it('takes the wind from where it comes', () => {
    expect(windOf({ wind_m_s: 5, from_deg: 270, flights: 0 }).map((axis) => Math.round(axis))).toEqual([0, 5, 0]);
  });

  it('is followed to its end, and belongs to the document that was flown', async () => {
    const operation = (state: string, result: object | null = null) => ({ id: 'o1', kind: 'dry_run', state, progress: 0.5, text: 'Step 3.', result });
    const answers: unknown[] = [operation('running'), VIEW];
    const asked: string[] = [];
    const api = new ApiClient('p', undefined, (path, init) => {
      asked.push(`${init.method} ${path.replace('/api/v1', '')}`);
      return Promise.resolve(new Response(JSON.stringify(answers.shift())));
    });
    const run = new DryRun(api);
    const event = (one: object) => ({ kind: 'operation', vehicle: null, unix_s: 0, severity: null, text: '', operation: one });
    await run.start(EMPTY, '1');
    await run.heard(event({ ...operation('succeeded', { dry_run: 'other' }), id: 'o2' }));
    expect([run.running, run.of(EMPTY)]).toEqual([true, null]);
    await run.heard(event(operation('succeeded', { dry_run: 'd7' })));
    expect(run.of(EMPTY)).toEqual(VIEW);
    expect(run.of({ ...EMPTY })).toBeNull();
    expect(asked).toEqual(['POST /dry_runs', 'GET /dry_runs/d7']);
  });
});
