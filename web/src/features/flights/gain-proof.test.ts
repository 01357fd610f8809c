import { beforeEach, describe, expect, it, vi, afterEach } from 'vitest';
import { ApiClient } from '../../api/client';
import { conditionsText, failedPairs, failureText, GainProof, worstPair, type Proof } from './gain-proof.svelte';

const run = (failures: Proof['pairs'][number]['proposed']['failures'] = []): Proof['pairs'][number]['proposed'] => ({
  failures,
  tilt_error_deg: 8,
  swing_deg_s: 2,
  saturated_share: 0,
  altitude_m: 0.1,
  position_m: 0.4,
});
const pair = (number: number, failures: Proof['pairs'][number]['proposed']['failures'] = []): Proof['pairs'][number] => ({
  number,
  conditions: { wind_ne_m_s: [3, 4], gusts_m_s: 1, mass: 1.05, thrust: 0.93, inertia: [1, 1.1, 0.9], lag: 1 },
  present: run(),
  proposed: run(failures),
});
const PROOF: Proof = {
  id: '1',
  vehicle: '1',
  passed: true,
  parameters: { MC_ROLLRATE_P: 0.18 },
  present: { MC_ROLLRATE_P: 0.15 },
  runs: 100,
  seed: 0,
  stable: 100,
  stable_at_present: 100,
  worst: 2,
  limits: { tilt_error_deg: 12, swing_deg_s: 12, saturated_share: 0.15, altitude_m: 1, position_m: 4, tilt_deg: 80 },
  spread: { wind_m_s: 2.5, gusts_m_s: 1.5, mass: 0.05, thrust: 0.07, inertia: 0.15, lag: 0.15 },
  pairs: [pair(1), pair(2)],
  assumed: [],
};
const OPERATION = { id: 'o1', kind: 'proof', state: 'running', progress: 0, text: 'Begins.', result: null, error: null };

describe('the proof of gains', () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  function made(ended: object, proof: Proof = PROOF) {
    const sent: { method: string; path: string; body: unknown }[] = [];
    const api = new ApiClient('test', undefined, (path, { method, body }) => {
      sent.push({ method: method ?? 'GET', path, body });
      if (path.endsWith('/proofs')) return Promise.resolve(Response.json(OPERATION, { status: 202 }));
      if (path.includes('/operations/')) return Promise.resolve(Response.json(method === 'DELETE' ? OPERATION : { ...OPERATION, ...ended }));
      return Promise.resolve(Response.json(proof));
    });
    return { gains: new GainProof(api), sent };
  }
  const SUCCEEDED = { state: 'succeeded', result: { proof: '1', passed: true } };

  it('opens writing only for exactly the values and the vehicle that passed', async () => {
    const { gains, sent } = made(SUCCEEDED);
    await gains.prove('1');
    expect(sent).toEqual([]); // nothing to prove
    gains.set('MC_ROLLRATE_P', 0.18);
    expect(gains.isProvedFor('1')).toBe(false);
    const proving = gains.prove('1');
    await vi.advanceTimersByTimeAsync(0);
    expect(gains.isRunning).toBe(true);
    await gains.prove('1'); // one at a time
    await vi.advanceTimersByTimeAsync(600);
    await proving;
    expect(sent.filter(({ method }) => method === 'POST')).toHaveLength(1);
    expect(JSON.parse(String(sent[0]?.body))).toEqual({ vehicle: '1', parameters: { MC_ROLLRATE_P: 0.18 }, runs: 100, seed: 0 });
    expect(gains.isRunning).toBe(false);
    expect(gains.isProvedFor('1')).toBe(true);
    expect(gains.isProvedFor('2')).toBe(false);
    expect(gains.resultFor('2')).toBe(null);
    gains.set('MC_ROLLRATE_P', 0.19);
    expect(gains.isProvedFor('1')).toBe(false);
    gains.set('MC_ROLLRATE_P', 0.18);
    expect(gains.isProvedFor('1')).toBe(true);
    gains.set('MC_ROLL_P', 7);
    expect(gains.isProvedFor('1')).toBe(false);
    gains.remove('MC_ROLL_P');
    expect(gains.isProvedFor('1')).toBe(true);
  });

  it('leaves writing closed after a failed, a short and a cancelled proof', async () => {
    for (const [ended, proof] of [
      [SUCCEEDED, { ...PROOF, passed: false }],
      [SUCCEEDED, { ...PROOF, runs: 10 }],
      [{ state: 'cancelled' }, PROOF],
    ] as const) {
      const { gains } = made(ended, proof);
      gains.set('MC_ROLLRATE_P', 0.18);
      const proving = gains.prove('1');
      await vi.advanceTimersByTimeAsync(0);
      await gains.cancel();
      await vi.advanceTimersByTimeAsync(600);
      await proving;
      expect(gains.isProvedFor('1')).toBe(false);
    }
  });

  it('says which flights failed, how, and in what conditions', () => {
    const failed = { ...PROOF, passed: false, pairs: [pair(1), pair(2, ['oscillates', 'saturated'])] };
    expect(failedPairs(failed).map(({ number }) => number)).toEqual([2]);
    expect(worstPair(failed)?.number).toBe(2);
    expect(failureText(['oscillates', 'saturated'])).toBe('oscillates in hover, drives motors to their limits');
    expect(conditionsText(pair(1))).toBe('wind 5.0 m/s, gusts 1.0 m/s, mass +5 %, thrust −7 %, inertia 0 % / +10 % / −10 %, motor lag 0 %');
  });
});
