/**
 * What the page subscribes to. A small fleet: everything of all, at the full rate while one is armed. A large one: for the
 * list and the map a few topics of all at a low rate, and the rest only of those that are looked at or flown from here.
 */

import { FLEET_TOPICS, PAGE_TOPICS } from './topics';

export interface Subscription {
  vehicles: '*' | string[];
  topics: string[];
  rate_hz: number;
}

/** Up to so many vehicles are all told in full. */
export const SMALL_FLEET = 8;
export const FULL_RATE_HZ = 25;
/** While none of them is armed. */
export const RESTING_RATE_HZ = 10;
export const FLEET_RATE_HZ = 2;

export function isLarge(count: number): boolean {
  return count > SMALL_FLEET;
}

/**
 * Of every vehicle.
 * @param more topics of values that a person chose to see.
 * @param armed whether one of them is.
 */
export function ofAll(count: number, more: readonly string[], armed: boolean): Subscription {
  if (isLarge(count)) return { vehicles: '*', topics: [...FLEET_TOPICS], rate_hz: FLEET_RATE_HZ };
  return { vehicles: '*', ...inFull(more, armed) };
}

/** Of those that are looked at or flown from here; null where `ofAll` tells everything. */
export function ofClose(count: number, ids: readonly string[], more: readonly string[], armed: boolean): Subscription | null {
  if (!isLarge(count) || ids.length === 0) return null;
  return { vehicles: [...new Set(ids)].sort(), ...inFull(more, armed) };
}

function inFull(more: readonly string[], armed: boolean): { topics: string[]; rate_hz: number } {
  return { topics: [...new Set([...PAGE_TOPICS, ...more])], rate_hz: armed ? FULL_RATE_HZ : RESTING_RATE_HZ };
}
