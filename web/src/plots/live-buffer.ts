/** Values of a plot that arrive, in bounded memory: older ones are thinned, and keep their extremes. */

import { indexAfter } from './plot-view.svelte';

export interface Points {
  readonly t_s: readonly number[];
  /** Null: not a number, or values before it are missing. */
  readonly values: readonly (number | null)[];
}

/** Values that are kept of one field. */
export const MAX_SAMPLES = 40_000;

/** At most about `points` values: of each run of equal length the lowest and the highest, and whether one is missing. */
export function thinned({ t_s, values }: Points, points: number): Points {
  const count = values.length;
  if (count <= points) return { t_s, values };
  const length = Math.ceil(count / Math.max(1, Math.floor(points / 2)));
  const kept: number[] = [];
  for (let begin = 0; begin < count; begin += length) {
    const found: number[] = [];
    let [low, high, missing] = [-1, -1, -1];
    for (let i = begin; i < Math.min(count, begin + length); i += 1) {
      const value = values[i] ?? null;
      if (value === null) missing = i;
      else if (low < 0 || value < (values[low] ?? 0)) low = i;
      if (value !== null && (high < 0 || value > (values[high] ?? 0))) high = i;
    }
    for (const i of [low, high, missing]) if (i >= 0 && !found.includes(i)) found.push(i);
    kept.push(...found.sort((a, b) => a - b));
  }
  return { t_s: kept.map((i) => t_s[i] ?? 0), values: kept.map((i) => values[i] ?? null) };
}

export class LiveBuffer {
  unit: string | null = null;
  private t_s: number[] = [];
  private values: (number | null)[] = [];

  /** Adds values; those that are not newer than the newest are here already. @param gap values between the newest and these are missing. */
  add({ t_s, values }: Points, gap: boolean): void {
    const newest_s = this.t_s.at(-1) ?? -Infinity;
    if (gap && this.t_s.length > 0) this.put(newest_s, null);
    for (const [i, at_s] of t_s.entries()) if (at_s > newest_s) this.put(at_s, values[i] ?? null);
    const half = MAX_SAMPLES / 2;
    while (this.t_s.length > MAX_SAMPLES) {
      const older = thinned({ t_s: this.t_s.slice(0, half), values: this.values.slice(0, half) }, half / 2);
      this.t_s = [...older.t_s, ...this.t_s.slice(half)];
      this.values = [...older.values, ...this.values.slice(half)];
    }
  }

  /** Forgets what is older. */
  forgetBefore(t_s: number): void {
    const first = this.t_s.findIndex((each) => each >= t_s);
    const count = first < 0 ? this.t_s.length : first;
    if (count === 0) return;
    this.t_s.splice(0, count);
    this.values.splice(0, count);
  }

  /** The values in a window, with one before and one after it. */
  within(from_s: number, to_s: number, points: number): Points {
    const first = Math.max(0, indexAfter(this.t_s, from_s) - 1);
    const end = indexAfter(this.t_s, to_s) + 1;
    return thinned({ t_s: this.t_s.slice(first, end), values: this.values.slice(first, end) }, points);
  }

  private put(at_s: number, value: number | null): void {
    this.t_s.push(at_s);
    this.values.push(value);
  }
}
