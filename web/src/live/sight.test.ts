import { describe, expect, it } from 'vitest';
import { FLEET_RATE_HZ, FULL_RATE_HZ, ofAll, ofClose, RESTING_RATE_HZ, SMALL_FLEET } from './sight';

describe('subscription', () => {
  it('tells all of a small fleet in full, by one subscription', () => {
    expect(ofAll(SMALL_FLEET, ['motors'], true)).toMatchObject({ vehicles: '*', rate_hz: FULL_RATE_HZ });
    expect(ofAll(SMALL_FLEET, ['motors'], true).topics).toEqual(expect.arrayContaining(['local_position', 'offboard', 'motors']));
    expect(ofClose(SMALL_FLEET, ['1'], [], true)).toBeNull();
  });

  it('tells a large fleet slowly, and only those in sight in full', () => {
    expect(ofAll(100, ['motors'], true)).toMatchObject({ vehicles: '*', rate_hz: FLEET_RATE_HZ });
    expect(ofAll(100, ['motors'], true).topics).not.toContain('motors');
    expect(ofClose(100, ['7', '3', '7'], ['motors'], true)).toMatchObject({ vehicles: ['3', '7'], rate_hz: FULL_RATE_HZ });
    expect(ofClose(100, [], [], true)).toBeNull();
  });

  it('tells vehicles that are disarmed slower, and a fleet that is told slowly anyway as before', () => {
    expect(ofAll(SMALL_FLEET, [], false).rate_hz).toBe(RESTING_RATE_HZ);
    expect(ofClose(100, ['7'], [], false)?.rate_hz).toBe(RESTING_RATE_HZ);
    expect(ofAll(100, [], false)).toEqual(ofAll(100, [], true));
  });

  it('hears the state and the place of every vehicle, whatever its number', () => {
    for (const count of [1, SMALL_FLEET + 1, 100])
      expect(ofAll(count, [], false).topics).toEqual(expect.arrayContaining(['status', 'global_position', 'identity']));
  });
});
