import { describe, expect, it } from 'vitest';
import { FLEET_RATE_HZ, FULL_RATE_HZ, fleetSubscription, detailSubscription, DISARMED_RATE_HZ, SMALL_FLEET } from './subscriptions';

describe('subscription', () => {
  it('has all topics of a small fleet in one subscription', () => {
    expect(fleetSubscription(SMALL_FLEET, ['motors'], true)).toMatchObject({ vehicles: '*', rate_hz: FULL_RATE_HZ });
    expect(fleetSubscription(SMALL_FLEET, ['motors'], true).topics).toEqual(expect.arrayContaining(['local_position', 'offboard', 'motors']));
    expect(detailSubscription(SMALL_FLEET, ['1'], [], true)).toBeNull();
  });

  it('has few topics at a low rate for a large fleet, and all topics only of the requested vehicles', () => {
    expect(fleetSubscription(100, ['motors'], true)).toMatchObject({ vehicles: '*', rate_hz: FLEET_RATE_HZ });
    expect(fleetSubscription(100, ['motors'], true).topics).not.toContain('motors');
    expect(detailSubscription(100, ['7', '3', '7'], ['motors'], true)).toMatchObject({ vehicles: ['3', '7'], rate_hz: FULL_RATE_HZ });
    expect(detailSubscription(100, [], [], true)).toBeNull();
  });

  it('has a lower rate while all vehicles are disarmed, except for the list of a large fleet', () => {
    expect(fleetSubscription(SMALL_FLEET, [], false).rate_hz).toBe(DISARMED_RATE_HZ);
    expect(detailSubscription(100, ['7'], [], false)?.rate_hz).toBe(DISARMED_RATE_HZ);
    expect(fleetSubscription(100, [], false)).toEqual(fleetSubscription(100, [], true));
  });

  it('has status and position of every vehicle in a fleet of any size', () => {
    for (const count of [1, SMALL_FLEET + 1, 100])
      expect(fleetSubscription(count, [], false).topics).toEqual(expect.arrayContaining(['status', 'global_position', 'identity']));
  });
});
