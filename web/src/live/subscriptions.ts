/**
 * The page's subscriptions. For a small fleet: all topics, at the full rate while a vehicle is armed. For a large fleet: a
 * few topics of all vehicles at a low rate, for list and map, and all topics of the vehicles that this page displays in
 * detail or commands.
 */

import { FLEET_TOPICS, PAGE_TOPICS } from './topics';

export interface Subscription {
  vehicles: '*' | string[];
  topics: string[];
  rate_hz: number;
}

/** Largest number of vehicles in a small fleet. */
export const SMALL_FLEET = 8;
export const FULL_RATE_HZ = 25;
/** Rate while no vehicle is armed. */
export const DISARMED_RATE_HZ = 10;
export const FLEET_RATE_HZ = 2;

export function isLarge(count: number): boolean {
  return count > SMALL_FLEET;
}

/**
 * Subscription to every vehicle.
 * @param gridTopics topics of the values on the grid. @param armed whether a vehicle is armed.
 */
export function fleetSubscription(count: number, gridTopics: readonly string[], armed: boolean): Subscription {
  if (isLarge(count)) return { vehicles: '*', topics: [...FLEET_TOPICS], rate_hz: FLEET_RATE_HZ };
  return { vehicles: '*', ...allTopics(gridTopics, armed) };
}

/** Subscription to all topics of these vehicles; null if `fleetSubscription` already includes them. */
export function detailSubscription(count: number, ids: readonly string[], gridTopics: readonly string[], armed: boolean): Subscription | null {
  if (!isLarge(count) || ids.length === 0) return null;
  return { vehicles: [...new Set(ids)].sort(), ...allTopics(gridTopics, armed) };
}

function allTopics(gridTopics: readonly string[], armed: boolean): { topics: string[]; rate_hz: number } {
  return { topics: [...new Set([...PAGE_TOPICS, ...gridTopics])], rate_hz: armed ? FULL_RATE_HZ : DISARMED_RATE_HZ };
}
