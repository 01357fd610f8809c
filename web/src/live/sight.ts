/**
 * What the page subscribes to. A small fleet: everything of all, at the full rate. A large one: for the list and the map
 * a few topics of all at a low rate, and the rest only of those that are looked at or flown from here.
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
export const FLEET_RATE_HZ = 2;

export function isLarge(count: number): boolean {
  return count > SMALL_FLEET;
}

/** Of every vehicle. */
export function ofAll(count: number, more: readonly string[]): Subscription {
  if (isLarge(count)) return { vehicles: '*', topics: [...FLEET_TOPICS], rate_hz: FLEET_RATE_HZ };
  return { vehicles: '*', topics: [...new Set([...PAGE_TOPICS, ...more])], rate_hz: FULL_RATE_HZ };
}

/** Of those that are looked at or flown from here; null where `ofAll` tells everything. */
export function ofClose(count: number, ids: readonly string[], more: readonly string[]): Subscription | null {
  if (!isLarge(count) || ids.length === 0) return null;
  return { vehicles: [...new Set(ids)].sort(), topics: [...new Set([...PAGE_TOPICS, ...more])], rate_hz: FULL_RATE_HZ };
}
