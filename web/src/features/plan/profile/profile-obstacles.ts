/** Obstacles below a path, for the altitude profile. Pure. */

import { eastNorth, type EastNorth, type GeoPosition } from '../../../vehicle/geo';
import { alt_home_m, type Obstacle, type PlannedHome } from '../document/document';

/** A part of the path inside the outline of an obstacle. */
export interface ObstacleSpan {
  /** Horizontal distances from the first point. */
  readonly from_m: number;
  readonly to_m: number;
  /** Altitude of the obstacle's top above home. */
  readonly top_m: number;
}

/** A position of the path with its horizontal distance from the first one. */
export interface PathPosition {
  readonly at: GeoPosition;
  readonly along_m: number;
}

export function obstacleSpans(way: readonly PathPosition[], obstacles: readonly Obstacle[], home: PlannedHome | null): ObstacleSpan[] {
  const reference = way[0]?.at;
  if (reference === undefined) return [];
  const positions = way.map(({ at }) => eastNorth(reference, at));
  return obstacles.flatMap((obstacle) => {
    const top_m = alt_home_m(obstacle.top, home);
    if (top_m === null) return [];
    const ring = obstacle.polygon.map((corner) => eastNorth(reference, corner));
    const found: ObstacleSpan[] = [];
    way.slice(1).forEach(({ along_m: end_m }, i) => {
      const [a, b, start_m] = [positions[i], positions[i + 1], way[i]?.along_m ?? 0];
      if (a === undefined || b === undefined) return;
      for (const [first, last] of insideParts(a, b, ring)) {
        const [from_m, to_m] = [start_m + first * (end_m - start_m), start_m + last * (end_m - start_m)];
        const before = found.at(-1);
        if (before !== undefined && from_m - before.to_m < 1e-6) found[found.length - 1] = { ...before, to_m };
        else found.push({ from_m, to_m, top_m });
      }
    });
    return found;
  });
}

/** The parts of a line inside a polygon, as shares of its length. */
function insideParts(a: EastNorth, b: EastNorth, ring: readonly EastNorth[]): [number, number][] {
  const [east_m, north_m] = [b.east_m - a.east_m, b.north_m - a.north_m];
  const cuts = [0, 1];
  ring.forEach((from, i) => {
    const to = ring[(i + 1) % ring.length] ?? from;
    const [side_e, side_n] = [to.east_m - from.east_m, to.north_m - from.north_m];
    const across = east_m * side_n - north_m * side_e;
    if (across === 0) return;
    const [away_e, away_n] = [from.east_m - a.east_m, from.north_m - a.north_m];
    const share = (away_e * side_n - away_n * side_e) / across;
    const onSide = (away_e * north_m - away_n * east_m) / across;
    if (share > 0 && share < 1 && onSide >= 0 && onSide <= 1) cuts.push(share);
  });
  cuts.sort((one, other) => one - other);
  return cuts.slice(1).flatMap((last, i): [number, number][] => {
    const first = cuts[i] ?? 0;
    const middle = (first + last) / 2;
    return last > first && isInside({ east_m: a.east_m + middle * east_m, north_m: a.north_m + middle * north_m }, ring) ? [[first, last]] : [];
  });
}

/** Whether a position is inside a polygon (even-odd rule). */
function isInside({ east_m, north_m }: EastNorth, ring: readonly EastNorth[]): boolean {
  return ring.reduce((inside, from, i) => {
    const to = ring[(i + 1) % ring.length] ?? from;
    const spans = from.north_m > north_m !== to.north_m > north_m;
    const crossing_m = from.east_m + ((north_m - from.north_m) / (to.north_m - from.north_m)) * (to.east_m - from.east_m);
    return spans && east_m < crossing_m ? !inside : inside;
  }, false);
}
