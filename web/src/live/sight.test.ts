import { describe, expect, it } from 'vitest';
import { FLEET_RATE_HZ, FULL_RATE_HZ, ofAll, ofClose, SMALL_FLEET } from './sight';

describe('subscription', () => {
  it('tells all of a small fleet in full, by one subscription', () => {
    expect(ofAll(SMALL_FLEET, ['motors'])).toMatchObject({ vehicles: '*', rate_hz: FULL_RATE_HZ });
    expect(ofAll(SMALL_FLEET, ['motors']).topics).toEqual(expect.arrayContaining(['local_position', 'offboard', 'motors']));
    expect(ofClose(SMALL_FLEET, ['1'], [])).toBeNull();
  });

  it('tells a large fleet slowly, and only those in sight in full', () => {
    expect(ofAll(100, ['motors'])).toMatchObject({ vehicles: '*', rate_hz: FLEET_RATE_HZ });
    expect(ofAll(100, ['motors']).topics).not.toContain('motors');
    expect(ofClose(100, ['7', '3', '7'], ['motors'])).toMatchObject({ vehicles: ['3', '7'], rate_hz: FULL_RATE_HZ });
    expect(ofClose(100, [], [])).toBeNull();
  });

  it('hears the state and the place of every vehicle, whatever its number', () => {
    for (const count of [1, SMALL_FLEET + 1, 100]) expect(ofAll(count, []).topics).toEqual(expect.arrayContaining(['status', 'global_position', 'identity']));
  });
});
