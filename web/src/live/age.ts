/** Ages of values: a value is stale after three periods of its topic. */

import { NOMINAL_PERIOD_S } from './topics';

const STALE_PERIODS = 3;
/** Smallest age of a stale value [s], so that one late packet causes no flicker. */
const MIN_STALE_AGE_S = 1;
/** A longer gap [s] is a pause and does not change the measured period. */
const MAX_PERIOD_S = 5;
const SMOOTHING = 0.2;

/** A topic's measured period, updated by the gap between its last two samples. */
export function updatedPeriod(period_s: number | null, gap_s: number): number | null {
  if (!(gap_s > 0) || gap_s > MAX_PERIOD_S) return period_s;
  return period_s === null ? gap_s : period_s + SMOOTHING * (gap_s - period_s);
}

/** The age [s] from which a topic's value is stale. */
export function staleAfterS(topic: string, period_s: number | null): number {
  const nominalPeriod_s = NOMINAL_PERIOD_S[topic] ?? 1;
  return Math.max(MIN_STALE_AGE_S, STALE_PERIODS * Math.max(period_s ?? nominalPeriod_s, 0));
}

/** An age as text without decimals, at least 1 s, for small labels. */
export function shortAge(age_s: number): string {
  return Number.isFinite(age_s) && age_s < 9.95 ? `${Math.max(1, Math.round(age_s))} s` : ageText(age_s);
}

/** An age as text: "4.0 s", "75 s", "2 min", "3 h". */
export function ageText(age_s: number): string {
  if (!Number.isFinite(age_s)) return '–';
  const s = Math.max(0, age_s);
  if (s < 9.95) return `${s.toFixed(1)} s`;
  if (s < 120) return `${Math.round(s)} s`;
  if (s < 7200) return `${Math.round(s / 60)} min`;
  return `${Math.round(s / 3600)} h`;
}
