import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../api/client';
import { LogView, type Overview } from './log-view.svelte';
import { autotuneRows, coherent, loopName, sentencesOf, Tuning, type LoopResponse } from './tuning.svelte';

const STEP = {
  t_s: [0, 0.02],
  value: [0, 0.4],
  lowest: null,
  highest: null,
  rise_s: 0.06,
  rise_range_s: [0.055, 0.07],
  overshoot: 0.12,
  overshoot_range: [0.1, 0.15],
  settling_s: 0.24,
  final: 0.8,
};
const LOOP: LoopResponse = {
  loop: 'rate',
  axis: 'roll',
  setpoint: 'degrees({vehicle_rates_setpoint:0/roll})',
  measured: 'degrees({vehicle_angular_velocity:0/xyz[0]})',
  rate_hz: 50,
  flown_s: 60,
  excited_s: 20,
  windows: 9,
  coherence: 0.97,
  step: STEP,
  frequency: {
    frequencies_hz: [0.25, 0.5],
    gain_db: [0, 1],
    phase_deg: [-5, -10],
    coherence: [0.9, 0.2],
    bandwidth_hz: 5.25,
    phase_at_bandwidth_deg: -110,
    peak_db: 1.4,
    peak_hz: 3,
  },
  notes: [],
};
const OVERVIEW = { kind: 'ulog', start_unix_s: null, duration_s: 100, vehicles: [], topics: [], messages: [], parameters: [] } as unknown as Overview;

describe('tuning', () => {
  it('says what the log says of a loop', () => {
    expect(loopName(LOOP)).toBe('Roll rate');
    expect(loopName({ loop: 'attitude', axis: 'yaw' })).toBe('Yaw angle');
    expect(sentencesOf(LOOP)).toEqual([
      'Rises in 60 ms, overshoots by 12 %.',
      'It stays within 5 % of its final value after 240 ms.',
      'It ends at 80 % of the setpoint.',
      'In parts of the flight it rises in 55 ms–70 ms and overshoots by 10 %–15 %.',
      'Bandwidth 5.3 Hz (−3 dB), phase −110° there.',
      'It answers strongest at 3.0 Hz: 1.4 dB above the setpoint.',
    ]);
    const calm = { ...LOOP, frequency: null, step: { ...STEP, overshoot: 0, final: 1, settling_s: null, rise_range_s: null } };
    expect(sentencesOf(calm)).toEqual(['Rises in 60 ms, without overshoot.', 'It does not settle within the shown time.']);
    expect(sentencesOf({ ...LOOP, step: null, frequency: null })).toEqual([]);
    expect(coherent([0, 1], [0.9, 0.2])).toEqual([0, null]);
  });

  it('asks for the part of the flight in the times of the vehicle’s own log, and drops the answer of another flight', async () => {
    const sent: string[] = [];
    const api = new ApiClient('test', undefined, (path) => {
      sent.push(path);
      return Promise.resolve(Response.json(path.includes('/loops') ? { loops: [LOOP] } : { series: [] }));
    });
    const view = new LogView(api);
    const tuning = new Tuning(api, view);
    await tuning.load({ from_s: 0, to_s: 9 });
    expect(sent).toEqual([]);
    const telemetry = { file: 'a', source: null, offset_s: 0, overview: { ...OVERVIEW, kind: 'tlog' as const } };
    view.parts = [telemetry, { file: 'b', source: null, offset_s: 10, overview: OVERVIEW }];
    await tuning.load({ from_s: 30, to_s: 50 });
    expect(sent).toEqual([expect.stringMatching(/\/flights\/b\/loops\?from_s=20&to_s=40$/)]);
    expect(tuning.loops).toEqual([LOOP]);
    tuning.show(LOOP);
    expect(view.panes.at(-1)?.fields).toEqual([`1|${LOOP.measured}`, `1|${LOOP.setpoint}`]);
    const late = tuning.load({ from_s: 0, to_s: 9 });
    tuning.reset();
    await late;
    expect(tuning.loops).toEqual([]);
    expect(tuning.isBusy).toBe(false);
  });

  it('lays the gains of autotune beside those of the log', () => {
    const found = { begin_s: 5, runs: 1, note: null, axes: [{ axis: 'yaw' as const, parameters: { MC_YAWRATE_K: 1, MC_YAW_P: 2.8 } }] };
    expect(autotuneRows(found, [{ name: 'MC_YAW_P', value: 2.5 }])).toEqual([
      { name: 'MC_YAWRATE_K', value: 1, present: null },
      { name: 'MC_YAW_P', value: 2.8, present: 2.5 },
    ]);
  });
});
