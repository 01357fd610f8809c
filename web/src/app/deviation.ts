/** Colours of a flown path by its distance from the planned one. */

import type { Tone } from './map-layers.svelte';

/** Largest distances [m] from the planned path in the colours of the flown path: PX4 turns within NAV_ACC_RAD, by default 2 m, before an item. */
export const DEVIATION_LIMITS_M = { ok: 2, caution: 5 } as const;

export function deviationTone(distance_m: number | null): Tone {
  if (distance_m === null || distance_m <= DEVIATION_LIMITS_M.ok) return 'actual';
  return distance_m <= DEVIATION_LIMITS_M.caution ? 'caution' : 'danger';
}
