import schema from '../../../api/schema.d.ts?raw';
import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../../api/client';
import { groundDistance_m, positionAt } from '../../../vehicle/geo';
import { EMPTY_PLAN } from '../document/document';
import { toDryRunRequest, DEFAULT_CONDITIONS, powerOf, CONDITION_ROWS, windOf, withCondition, type ConditionRow } from './conditions';
import { DryRun, type DryRunResult } from './dry-run.svelte';
import { dryRunLayer, findingPosition, simulatedVehicleAt, simulatedVehicleLayer, resultLines } from './dry-run-layer';
import { plotPaths, timeAfterKey, QUANTITIES, traceOf, valueAt, type Trace } from './dry-run-trace';

const ORIGIN = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const RESULT = {
  nominal: {
    origin: ORIGIN,
    px4: '1.17',
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
      q_ned_frd: [
        [1, 0, 0, 0],
        [Math.SQRT1_2, 0, 0, Math.SQRT1_2],
        [1, 0, 0, 0],
      ],
      gimbal_rad: [
        [0, 0],
        [-Math.PI / 4, Math.PI],
        [-Math.PI / 2, 0],
      ],
      battery_share: [1, 0.9, 0.81],
      ground_m: null,
      step: [0, 1, -1],
      step_places: ['step 1', 'step 2'],
    },
  },
  monte_carlo: null,
  group: null,
} as unknown as DryRunResult;
const TWO_ROLES = {
  ...RESULT,
  group: {
    roles: {
      lead: RESULT.nominal,
      left: { ...RESULT.nominal, path: { ...RESULT.nominal.path, position_ned_m: RESULT.nominal.path?.position_ned_m.map(([n = 0, , d = 0]) => [n, 9, d]) } },
    },
    closest: [{ roles: ['lead', 'left'], distance_m: 8.96, t_s: 65 }],
  },
} as unknown as DryRunResult;
const MONTE_CARLO = {
  ...RESULT,
  monte_carlo: {
    flights: [{}, {}],
    corridor: {
      t_s: RESULT.nominal.path?.t_s,
      position_ned_m: RESULT.nominal.path?.position_ned_m,
      horizontal_m: { p95: [1, 1, 2] },
      vertical_m: { p5: [0, 0, -1], p95: [0, 0, 2] },
    },
    duration_s: { p5: 60, p95: 70 },
    battery_end_share: { p5: 0.7 },
  },
} as unknown as DryRunResult;

const MONTE_CARLO_TWO_ROLES = {
  ...MONTE_CARLO,
  group: {
    ...TWO_ROLES.group,
    monte_carlo: {
      roles: { lead: MONTE_CARLO.monte_carlo, left: { ...MONTE_CARLO.monte_carlo, battery_end_share: null } },
      closest: [{ roles: ['lead', 'left'], distance_m: { least: 6.21 }, nearer_than_minimum: { count: 0, upper: 0.161 } }],
    },
  },
} as unknown as DryRunResult;

describe('a dry run', () => {
  it('interpolates the vehicle’s position between samples, and clamps it at both ends', () => {
    const vehicle = simulatedVehicleAt(RESULT, 15);
    expect(groundDistance_m(vehicle ?? ORIGIN, positionAt(ORIGIN, { north_m: 50, east_m: 0 }))).toBeLessThan(0.01);
    expect(vehicle).toMatchObject({ up_m: 10, speed_m_s: 5, step: 'step 2' });
    expect(simulatedVehicleAt(RESULT, 99)).toMatchObject({ up_m: 10, step: '' });
    expect(simulatedVehicleAt(RESULT, -1)).toMatchObject({ up_m: 0, step: 'step 1' });
    expect(simulatedVehicleAt({ nominal: { ...RESULT.nominal, path: null } } as DryRunResult, 1)).toBeNull();
  });

  it('draws the path and the corridor of many flights', () => {
    const layer = dryRunLayer(MONTE_CARLO);
    expect(layer.lines[0]?.positions).toHaveLength(3);
    const [area] = layer.areas;
    expect(area?.ring).toHaveLength(4);
    expect(groundDistance_m(area?.ring[1] ?? ORIGIN, positionAt(ORIGIN, { north_m: 100, east_m: 0 }))).toBeCloseTo(2, 1);
    expect(dryRunLayer(RESULT).areas).toEqual([]);
    expect(dryRunLayer(MONTE_CARLO_TWO_ROLES).areas).toHaveLength(2);
  });

  it('draws the corridor of a path that turns back as areas that do not cross each other', () => {
    const outbound = Array.from({ length: 9 }, (_, i) => [i * 10, 0, -10]);
    const inbound = Array.from({ length: 8 }, (_, i) => [80 - i * 10, 10, -10]);
    const position_ned_m = [[0, 0, 0], [0, 0.1, -5], ...outbound, ...inbound];
    const p95 = position_ned_m.map(() => 2);
    const corridor = { t_s: p95, position_ned_m, horizontal_m: { p95 }, vertical_m: { p5: p95, p95 } };
    const { areas } = dryRunLayer({ ...MONTE_CARLO, monte_carlo: { ...MONTE_CARLO.monte_carlo, corridor } } as unknown as DryRunResult);
    expect(areas.map(({ ring }) => ring.length)).toEqual([10, 10, 10, 10]); // samples nearer than 0.5 m to each other are one point
    const east_m = (position: { lat_deg: number; lon_deg: number }) => groundDistance_m(position, { ...position, lon_deg: ORIGIN.lon_deg });
    expect(Math.max(...(areas[0]?.ring ?? []).map(east_m))).toBeLessThan(2.1);
    expect(Math.min(...(areas[3]?.ring ?? []).map(east_m))).toBeGreaterThan(7.9);
  });

  it('draws the vehicle with its heading, and the ground that its camera sees', () => {
    const layer = simulatedVehicleLayer(RESULT, 10);
    expect(layer?.points).toMatchObject([{ id: 'simulated vehicle', mark: 'vehicle', yaw_deg: expect.closeTo(90) }]);
    const groundCorner = layer?.areas[0]?.ring[2] ?? ORIGIN;
    expect(groundDistance_m(groundCorner, positionAt(ORIGIN, { north_m: -10, east_m: 0 }))).toBeLessThan(0.01);
    expect(simulatedVehicleLayer(RESULT, 20)?.areas).toEqual([]);
    expect(simulatedVehicleLayer({ nominal: { ...RESULT.nominal, path: null } } as DryRunResult, 1)).toBeNull();
    expect(simulatedVehicleLayer(TWO_ROLES, 10)?.points.map(({ id }) => id)).toEqual(['simulated vehicle', 'simulated vehicle 1']);
    expect(dryRunLayer(TWO_ROLES).lines).toHaveLength(2);
  });

  it('plots values over time, with the band of 90 % of many flights', () => {
    const trace = (quantity: (typeof QUANTITIES)[number], result = RESULT): Trace => traceOf(result, quantity) as Trace;
    expect(QUANTITIES.map((quantity) => valueAt(trace(quantity), 10))).toEqual([10, 5, 0, 90]);
    expect(valueAt(trace('altitude'), 5)).toBe(5);
    expect([trace('altitude').top, trace('altitude').bottom, trace('altitude').end_s, trace('altitude').band]).toEqual([10, 0, 20, []]);
    expect(trace('altitude', MONTE_CARLO).band[2]).toEqual([20, 9, 12]);
    expect(trace('altitude', MONTE_CARLO).top).toBe(20);
    expect(trace('speed', MONTE_CARLO).band).toEqual([]);
    expect(plotPaths(trace('altitude'), 100, 50)).toEqual({ line: 'M0.0 50.0L50.0 0.0L100.0 0.0', band: '', ground: '', zero_y: 50 });
    expect(plotPaths(trace('altitude', MONTE_CARLO), 100, 50).band).toMatch(/^M.*Z$/);
  });

  it('shows the terrain below the path, in a scale that contains both', () => {
    const hillyResult = { ...RESULT, nominal: { ...RESULT.nominal, path: { ...RESULT.nominal.path, ground_m: [0, 5, 20] } } } as DryRunResult;
    const altitude = traceOf(hillyResult, 'altitude');
    expect(altitude?.top).toBe(20);
    expect(altitude && plotPaths(altitude, 100, 40).ground).toBe('M0 40L0.0 40.0L50.0 30.0L100.0 0.0L100 40Z');
    expect(traceOf(hillyResult, 'speed')?.ground).toEqual([]);
    const path = { ...RESULT.nominal.path, battery_share: null };
    expect(traceOf({ ...RESULT, nominal: { ...RESULT.nominal, path } } as DryRunResult, 'battery')).toBeNull();
  });

  it('has keys that change the shown time, between start and end', () => {
    expect(timeAfterKey('ArrowRight', false, 5, 20)).toBe(6);
    expect(timeAfterKey('ArrowLeft', true, 5, 20)).toBeCloseTo(4.9);
    expect(timeAfterKey('PageUp', false, 15, 20)).toBe(20);
    expect([timeAfterKey('Home', false, 5, 20), timeAfterKey('End', false, 5, 20), timeAfterKey('a', false, 5, 20)]).toEqual([0, 20, null]);
  });

  it('has a result with numbers', () => {
    expect(resultLines(RESULT)).toEqual(['Dry run: 1 min 05 s, 120 m, battery 100 % → 81 %; simulated PX4 v1.17.']);
    expect(resultLines(TWO_ROLES)[1]).toBe('lead and left stay at least 9.0 m apart; they are closest after 1 min 05 s.');
    expect(resultLines(MONTE_CARLO)[1]).toBe(
      '2 simulated flights: 95 % within 2.0 m of the path; flight time 1 min 00 s to 1 min 10 s (5th to 95th percentile); 95 % with at least 70 % battery at the end.',
    );
    expect(resultLines(MONTE_CARLO_TWO_ROLES).slice(2)).toEqual([
      'lead, 2 simulated flights: 95 % within 2.0 m of the path; flight time 1 min 00 s to 1 min 10 s (5th to 95th percentile); 95 % with at least 70 % battery at the end.',
      'left, 2 simulated flights: 95 % within 2.0 m of the path; flight time 1 min 00 s to 1 min 10 s (5th to 95th percentile).',
      'Smallest separation of lead and left in all flights: 6.2 m. In 0 flights they came closer than the minimum separation (estimated probability: at most 16 %).',
    ]);
  });

  it('converts the direction that the wind comes from to a velocity', () => {
    expect(windOf({ ...DEFAULT_CONDITIONS, wind_m_s: 5, from_deg: 270 }).map((axis) => Math.round(axis))).toEqual([0, 5, 0]);
  });

  it('sends mass, battery and endurance as entered', () => {
    const enteredConditions = {
      ...DEFAULT_CONDITIONS,
      mass_percent: 110,
      battery_percent: 90,
      flights: 20,
      hover_power_w: 200,
      battery_wh: 100,
      reserve_percent: 30,
    };
    expect(toDryRunRequest(enteredConditions)).toMatchObject({
      conditions: { mass_scale: 1.1, battery_scale: 0.9 },
      flights: 20,
      endurance_s: 1800,
      battery_reserve: 0.3,
    });
    expect(toDryRunRequest(DEFAULT_CONDITIONS)).toMatchObject({ flights: null, endurance_s: null, conditions: { sensor_noise: 1 } });
    const variedConditions = { ...DEFAULT_CONDITIONS, noise_percent: 200, spread_wind_m_s: 3, spread_mass_percent: 10, spread_noise_percent: 0 };
    expect(toDryRunRequest(variedConditions)).toMatchObject({
      conditions: { sensor_noise: 2 },
      spread: { wind_m_s: 3, gusts: 0.3, mass: 0.1, battery: 0.05, sensor_noise: 0 },
    });
    expect(powerOf(enteredConditions)).toBeNull();
    expect(powerOf({ ...enteredConditions, mass_kg: 2 })).toEqual({ hover_power_w: 200, battery_wh: 100, mass_kg: 2, reserve: 0.3 });
    const row = (name: string) => CONDITION_ROWS.find((condition) => condition.name === name) as ConditionRow;
    expect(withCondition(enteredConditions, row('flights'), 7.6).flights).toBe(8);
    expect(withCondition(enteredConditions, row('hover_power_w'), null).hover_power_w).toBeNull();
    expect(withCondition(enteredConditions, row('wind_m_s'), null)).toBe(enteredConditions);
  });

  it('has the server’s default variations of the conditions', () => {
    const server = [...schema.matchAll(/DryRunSpread: \{[\s\S]*?\n {8}\};/g)][0]?.[0] ?? '';
    const { spread } = toDryRunRequest(DEFAULT_CONDITIONS);
    for (const [name, value] of Object.entries(spread)) expect(server, name).toMatch(new RegExp(`@default ${value}\\s+\\*/\\s+readonly ${name}:`));
  });

  it('has a result for exactly the document that was simulated', async () => {
    const operation = (state: string, result: object | null = null) => ({ id: 'o1', kind: 'dry_run', state, progress: 0.5, text: 'Step 3.', result });
    const responses: unknown[] = [operation('running'), RESULT];
    const requests: string[] = [];
    const api = new ApiClient('p', undefined, (path, init) => {
      requests.push(`${init.method} ${path.replace('/api/v1', '')}`);
      return Promise.resolve(new Response(JSON.stringify(responses.shift())));
    });
    const dryRun = new DryRun(api);
    const event = (operation: object) => ({ kind: 'operation', vehicle: null, unix_s: 0, severity: null, text: '', operation });
    await dryRun.start(EMPTY_PLAN, { vehicle: '1' }, DEFAULT_CONDITIONS);
    await dryRun.handleEvent(event({ ...operation('succeeded', { dry_run: 'other' }), id: 'o2' }));
    expect([dryRun.running, dryRun.resultOf(EMPTY_PLAN)]).toEqual([true, null]);
    await dryRun.handleEvent(event(operation('succeeded', { dry_run: 'd7' })));
    expect(dryRun.resultOf(EMPTY_PLAN)).toEqual(RESULT);
    expect(dryRun.resultOf({ ...EMPTY_PLAN })).toBeNull();
    expect(requests).toEqual(['POST /dry_runs', 'GET /dry_runs/d7']);
  });

  it('has a result also if the event of its end arrives before the response to its start', async () => {
    const running = { id: 'o1', kind: 'dry_run', state: 'running', progress: 0, text: '', result: null };
    const responses: unknown[] = [running, RESULT];
    const api = new ApiClient('p', undefined, () => Promise.resolve(new Response(JSON.stringify(responses.shift()))));
    const run = new DryRun(api);
    const started = run.start(EMPTY_PLAN, { vehicle: '1' }, DEFAULT_CONDITIONS);
    const operation = { ...running, state: 'succeeded', result: { dry_run: 'd7' } };
    await run.handleEvent({ kind: 'operation', vehicle: null, unix_s: 0, severity: null, text: '', operation });
    expect(run.resultOf(EMPTY_PLAN)).toBeNull();
    await started;
    expect([run.running, run.resultOf(EMPTY_PLAN)]).toEqual([false, RESULT]);
  });
});

it('a finding is shown at its position, or else at the position of the vehicle at the time of the finding', () => {
  expect(findingPosition(RESULT, { position_ned_m: [30, -4, -10], t_s: 15 })).toEqual(positionAt(ORIGIN, { north_m: 30, east_m: -4 }));
  const halfWay = findingPosition(RESULT, { position_ned_m: null, t_s: 15 });
  expect(halfWay === null ? null : groundDistance_m(halfWay, positionAt(ORIGIN, { north_m: 50, east_m: 0 }))).toBeCloseTo(0, 3);
  expect(findingPosition(RESULT, { position_ned_m: null, t_s: null })).toBeNull();
});

it('a chosen time stops the playback', () => {
  const dryRun = new DryRun(new ApiClient('p'));
  dryRun.playing = true;
  dryRun.showTime(12);
  expect([dryRun.playing, dryRun.t_s]).toEqual([false, 12]);
});
