import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';
import { ApiClient } from '../../api/client';
import { LogView } from './log-view.svelte';
import { labelOf } from '../../plots/sets';
import { apart_m, plotsOf, WhatIf, type Rerun } from './what-if.svelte';

const track = (north: number): Rerun['logged'] => ({
  position_ned_m: [
    [0, 1, -5],
    [north, 1, -6],
  ],
  velocity_ned_m_s: [
    [0, 0, 0],
    [1, 0, 0],
  ],
  attitude_deg: [
    [0, 0, 90],
    [2, -3, 90],
  ],
});
const RESULT: Rerun = {
  t_s: [30, 30.1],
  logged: track(1),
  unchanged: track(1.5),
  changed: track(4.5),
  error_m: [0, 0.5],
  error_deg: [0, 1],
  max_error_m: 0.5,
  max_error_deg: 1,
  wind_ned_m_s: [0, 3, 0],
  source: 'parameters',
  model: {},
  notes: [],
};
const OVERVIEW = {
  kind: 'ulog',
  start_unix_s: null,
  duration_s: 100,
  firmware: null,
  hardware: null,
  vehicles: [],
  topics: [],
  parameters: [],
  parameter_changes: [],
  messages: [],
  messages_left_out: 0,
  dropouts: [],
  problems: [],
};

interface Sent {
  readonly path: string;
  readonly body: unknown;
}

describe('what if', () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  async function opened(answer: { status: number; value: unknown } = { status: 200, value: RESULT }) {
    const sent: Sent[] = [];
    let release = (): void => undefined;
    const api = new ApiClient('test', undefined, async (path, { method, body }) => {
      sent.push({ path, body });
      const isRerun = path.includes('/rerun');
      if (isRerun) await new Promise<void>((resolve) => (release = resolve));
      if (isRerun) return Response.json(answer.value, { status: answer.status });
      expect(method).toBe('GET');
      return Response.json(path.includes('/series') ? { series: [] } : OVERVIEW);
    });
    const view = new LogView(api);
    await view.open('f1', 'a.ulg');
    return { view, whatIf: new WhatIf(api, view), sent, answerNow: () => release() };
  }

  it('sends exactly the change, and shows the tracks beside each other over their time', async () => {
    const { view, whatIf, sent, answerNow } = await opened();
    whatIf.setParameter('MPC_XY_P', 0.5);
    whatIf.setParameter('MPC_XY_P', 0.7);
    whatIf.stoppedMotor = 2;
    whatIf.windEast = '-4';
    whatIf.movedEast = '3';
    whatIf.movedUp = '2';
    const flown = whatIf.fly(30);
    await vi.advanceTimersByTimeAsync(10);
    expect(whatIf.isBusy).toBe(true);
    void whatIf.fly(31); // a second press while it flies asks nothing
    answerNow();
    await flown;
    const asked = sent.filter(({ path }) => path.includes('/rerun'));
    expect(asked.map(({ body }) => JSON.parse(String(body)) as unknown)).toEqual([
      { from_s: 30, duration_s: 20, parameters: { MPC_XY_P: 0.7 }, wind_ned_m_s: [0, -4, 0], moved_ned_m: [0, 3, -2], motor_health: [1, 0, 1, 1] },
    ]);
    expect(view.panes.map(({ fields }) => fields.map(labelOf))[1]).toEqual(['North, logged', 'North, unchanged', 'North, changed']);
    expect(view.shown).toEqual({ from_s: 30, to_s: 30.1 });
    await vi.advanceTimersByTimeAsync(200);
    expect(sent.some(({ path }) => path.includes('/series'))).toBe(false);
    expect(view.series.get('rerun/Height, changed')?.values).toEqual([5, 6]);
  });

  it('sends a changed failsafe or plan item for the simulated PX4 to fly on with', async () => {
    const { whatIf } = await opened();
    whatIf.choose('failsafe');
    expect([whatIf.duration, whatIf.maxDuration_s, whatIf.isValid]).toEqual(['60', 600, true]);
    whatIf.setParameter('COM_LOW_BAT_ACT', 3);
    whatIf.battery = '6';
    whatIf.lost = 'gps';
    whatIf.movedNorth = '5';
    const common = { from_s: 30, duration_s: 60, parameters: { COM_LOW_BAT_ACT: 3 }, wind_ned_m_s: null, motor_health: null, flown_by: 'autopilot' };
    expect(whatIf.body(30)).toEqual({ ...common, plan: null, battery_percent: 6, lost: ['gps'] });
    whatIf.battery = '101';
    expect(whatIf.isValid).toBe(false);
    whatIf.choose('item');
    expect(whatIf.isValid).toBe(false); // which item is not said
    whatIf.item = '1.5';
    expect(whatIf.isValid).toBe(false);
    Object.assign(whatIf, { item: '3', speed: '2', then: 'return', plan: 'a1', duration: '90' });
    expect(whatIf.isValid).toBe(true);
    const item = { number: 3, moved_ned_m: [5, 0, 0], speed_m_s: 2, then: 'return' };
    expect(whatIf.body(30)).toEqual({ ...common, duration_s: 90, plan: 'a1', item });
    whatIf.choose('control');
    expect(whatIf.duration).toBe('90'); // a person's own
    expect(whatIf.body(30)).not.toHaveProperty('flown_by');
  });

  it('sends a changed step of the offboard mission that was noted or is chosen', async () => {
    const { view, whatIf } = await opened();
    whatIf.choose('item');
    expect(whatIf.isOfMission).toBe(false);
    whatIf.plans = [
      { id: 'b2', kind: 'offboard_mission' },
      { id: 'a1', kind: 'waypoint_plan' },
    ] as unknown as typeof whatIf.plans;
    whatIf.plan = 'b2';
    expect([whatIf.isOfMission, whatIf.isValid]).toEqual([true, false]); // which step is not said
    Object.assign(whatIf, { step: ' 4.2 ', point: '0', movedUp: '3', stepDuration: '5', item: '9' });
    expect(whatIf.isValid).toBe(false);
    Object.assign(whatIf, { point: '2' });
    expect(whatIf.isValid).toBe(true);
    const step = { place: 'step 4.2', point: 2, moved_ned_m: [0, 0, -3], speed_m_s: null, duration_s: 5 };
    expect(whatIf.body(30)).toMatchObject({ plan: 'b2', step });
    expect(whatIf.body(30)).not.toHaveProperty('item');
    whatIf.step = 'four';
    expect(whatIf.isValid).toBe(false);
    whatIf.plan = 'a1';
    expect(whatIf.isOfMission).toBe(false);
    whatIf.plan = '';
    view.record = { plan: { kind: 'offboard_mission' } } as unknown as typeof view.record;
    expect(whatIf.isOfMission).toBe(true);
    whatIf.choose('failsafe');
    expect(whatIf.isOfMission).toBe(false);
  });

  it('draws each path as long as its flight', async () => {
    const short = { ...RESULT, changed: { ...RESULT.changed, position_ned_m: [[0, 1, -5]], attitude_deg: [[0, 0, 90]] } };
    const { view, whatIf, answerNow } = await opened({ status: 200, value: short });
    const flown = whatIf.fly(30);
    await vi.advanceTimersByTimeAsync(10);
    answerNow();
    await flown;
    expect(whatIf.paths.map(({ t_s }) => t_s)).toEqual([[30, 30.1], [30]]);
    expect(view.series.get('rerun/Height, changed')).toMatchObject({ t_s: [30], values: [5], samples: 1 });
  });

  it('is not shown in a log that was opened meanwhile', async () => {
    const { view, whatIf, answerNow } = await opened();
    const flown = whatIf.fly(30);
    await vi.advanceTimersByTimeAsync(10);
    await view.open('f2', 'b.ulg');
    whatIf.reset();
    answerNow();
    await flown;
    expect([whatIf.result, whatIf.isBusy, view.series.size]).toEqual([null, false, 0]);
  });

  it('says why a part cannot be flown, and keeps the change', async () => {
    const problem = { type: 'about:blank', title: 'Invalid request', detail: 'The vehicle is not in the air at 2.0 s.', status: 422, code: 'invalid_request' };
    const { whatIf, answerNow } = await opened({ status: 422, value: problem });
    whatIf.setParameter('MC_ROLL_P', 4);
    const flown = whatIf.fly(2);
    await vi.advanceTimersByTimeAsync(10);
    answerNow();
    await flown;
    expect(whatIf.problem?.detail).toContain('not in the air');
    expect([whatIf.isBusy, whatIf.parameters.length]).toEqual([false, 1]);
  });

  it('measures how far two tracks are apart', () => {
    expect(apart_m(RESULT.unchanged, RESULT.changed)).toBe(3);
    expect(plotsOf(RESULT).series.length).toBe(16);
  });
});
