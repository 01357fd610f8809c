import { describe, expect, it } from 'vitest';
import { positionAt } from '../../../vehicle/geo';
import { EMPTY_PLAN } from '../document/document';
import type { DryRunResult } from '../dry-run/dry-run.svelte';
import { startBody, startTexts } from './mission-start';
import { dryRunIdFor, flightLabel, flightProgress, flightText, fliesMission, hasEnded, type WaypointFlight } from './mission-start';

const FLIGHT: WaypointFlight = {
  state: 'flying',
  name: 'Tower',
  plan_id: 'abc',
  version: 2,
  client: 'anna',
  started_unix_s: 100,
  item: 1,
  count: 3,
  place: 'item 2',
  title: 'Waypoint',
  planned_by: 'dry_run',
  dry_run: '4',
  duration_s: 80,
  remaining_s: 60,
  deviation_horizontal_m: 1.24,
  deviation_vertical_m: -0.31,
  outside_corridor_m: 0,
  not_compared: null,
  reason: null,
};
const NO_COMPARISON = { planned_by: null, duration_s: null, remaining_s: null, deviation_horizontal_m: null, deviation_vertical_m: null } as const;

describe('a monitored flight', () => {
  it('shows its remaining time and its deviation in one line', () => {
    expect(flightText(FLIGHT)).toBe('01:00 remaining · 1.2 m beside and 0.3 m below the path of the dry run');
    const planText = flightText({ ...FLIGHT, planned_by: 'plan', deviation_vertical_m: 0.2 });
    expect(planText).toBe('about 01:00 remaining · 1.2 m beside and 0.2 m above the straight lines of the plan');
    expect(flightText({ ...FLIGHT, deviation_horizontal_m: null, deviation_vertical_m: null })).toBe('01:00 remaining');
    expect(flightText({ ...FLIGHT, ...NO_COMPARISON })).toBeNull();
  });

  it('shows the elapsed part of the planned time', () => {
    expect([flightProgress(FLIGHT), flightProgress({ ...FLIGHT, remaining_s: 90 }), flightProgress({ ...FLIGHT, ...NO_COMPARISON })]).toEqual([0.25, 0, null]);
  });

  it('is being flown in Mission and in the Return of its plan, but not in a Return that somebody commanded', () => {
    const status = (mode: string, armed = true) => ({ mode, armed }) as never;
    expect([fliesMission(status('mission'), null), fliesMission(status('rtl'), FLIGHT)]).toEqual([true, true]);
    expect([
      fliesMission(status('rtl'), { ...FLIGHT, state: 'paused' }),
      fliesMission(status('rtl'), null),
      fliesMission(status('hold'), FLIGHT),
      fliesMission(status('mission', false), FLIGHT),
    ]).toEqual([false, false, false, false]);
  });

  it('has a label for each state, and is ended when done or stopped', () => {
    const states = (['flying', 'paused', 'done', 'stopped'] as const).map((state) => ({ ...FLIGHT, state }));
    expect(states.map(hasEnded)).toEqual([false, false, true, true]);
    expect(states.map((flight) => flightLabel(flight).text)).toEqual(['Flying', 'Paused: not in Mission mode', 'Done', 'Ended early']);
  });
});

describe('the dry run that a flight is compared with', () => {
  const origin = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
  const result = { id: '4', vehicle: '1', nominal: { finished: true, origin } } as unknown as DryRunResult;
  const nearStart = positionAt(origin, { north_m: 3, east_m: 0 });

  it('is completed, of the same vehicle and from the same start', () => {
    expect(dryRunIdFor(result, '1', nearStart)).toBe('4');
    expect(dryRunIdFor(result, '2', nearStart)).toBeNull();
    expect(dryRunIdFor(result, '1', null)).toBeNull();
    expect(dryRunIdFor(null, '1', nearStart)).toBeNull();
    expect(dryRunIdFor(result, '1', positionAt(origin, { north_m: 6, east_m: 0 }))).toBeNull();
    expect(dryRunIdFor({ ...result, nominal: { ...result.nominal, finished: false } }, '1', nearStart)).toBeNull();
  });

  it('is mentioned in the confirmation and sent in the request', () => {
    expect(startTexts('Quad 1', false, null, [], '4').effect).toContain('The flight is compared with the dry run.');
    expect(startTexts('Quad 1', false, null, []).effect).not.toContain('dry run');
    expect(startBody(EMPTY_PLAN, false, null, [], 0, '4')).toEqual({ item: 0, despite: [], dry_run: '4' });
  });
});
