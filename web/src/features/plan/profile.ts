/** Altitude along the way: what the strip below the map shows. Pure. */

import { groundDistance_m } from '../../vehicle/geo';
import { alt_home_m, path, type Plan } from './document';

export interface ProfilePoint {
  readonly row: number;
  /** Along the ground from the first point [m]. */
  readonly along_m: number;
  /** Above home [m]; null: it cannot be said. */
  readonly alt_home_m: number | null;
}

export interface Profile {
  readonly points: readonly ProfilePoint[];
  readonly length_m: number;
  readonly top_m: number;
  readonly bottom_m: number;
}

const ROUND_M = 10;

/** From home, where it is planned, through everything that is flown to. */
export function profile(plan: Plan): Profile {
  let along_m = 0;
  const home = plan.planned_home;
  const way = path(plan);
  const points: ProfilePoint[] = home === null || way.length === 0 ? [] : [{ row: -1, along_m: 0, alt_home_m: 0 }];
  way.forEach(({ row, item }, i) => {
    const before = way[i - 1]?.item ?? home;
    if (before !== null && before !== undefined) along_m += groundDistance_m(before, item);
    points.push({ row, along_m, alt_home_m: alt_home_m(item.altitude, home) });
  });
  const known = points.flatMap((point) => point.alt_home_m ?? []);
  const top_m = Math.max(ROUND_M, Math.ceil((Math.max(0, ...known) * 1.1) / ROUND_M) * ROUND_M);
  const bottom_m = Math.min(0, Math.floor(Math.min(0, ...known) / ROUND_M) * ROUND_M);
  return { points, length_m: along_m, top_m, bottom_m };
}

/** The known parts as polylines in a box of this size, y downwards. */
export function polylines({ points, length_m, top_m, bottom_m }: Profile, width: number, height: number): { x: number; y: number; row: number }[][] {
  const parts: { x: number; y: number; row: number }[][] = [[]];
  for (const point of points) {
    if (point.alt_home_m === null) {
      if (parts.at(-1)?.length !== 0) parts.push([]);
      continue;
    }
    const x = length_m === 0 ? 0 : (point.along_m / length_m) * width;
    parts.at(-1)?.push({ x, y: ((top_m - point.alt_home_m) / (top_m - bottom_m)) * height, row: point.row });
  }
  return parts.filter((part) => part.length > 0);
}
