/** Obstacles below a path, for the altitude profile. Pure functions. */

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

/** A position of the path with its horizontal distance from the first position. */
export interface PathPosition {
  readonly at: GeoPosition;
  readonly distance_m: number;
}

/** The parts of the path that cross obstacles. Obstacles whose top has no known altitude above home are omitted. */
export function obstacleSpans(path: readonly PathPosition[], obstacles: readonly Obstacle[], home: PlannedHome | null): ObstacleSpan[] {
  const reference = path[0]?.at;
  if (reference === undefined) return [];
  const positions = path.map(({ at }) => eastNorth(reference, at));
  return obstacles.flatMap((obstacle) => {
    const top_m = alt_home_m(obstacle.top, home);
    if (top_m === null) return [];
    const ring = obstacle.polygon.map((corner) => eastNorth(reference, corner));
    const spans: ObstacleSpan[] = [];
    path.slice(1).forEach(({ distance_m: end_m }, i) => {
      const [a, b, start_m] = [positions[i], positions[i + 1], path[i]?.distance_m ?? 0];
      if (a === undefined || b === undefined) return;
      for (const [first, last] of insideParts(a, b, ring)) {
        const [from_m, to_m] = [start_m + first * (end_m - start_m), start_m + last * (end_m - start_m)];
        const previous = spans.at(-1);
        if (previous !== undefined && from_m - previous.to_m < 1e-6) spans[spans.length - 1] = { ...previous, to_m };
        else spans.push({ from_m, to_m, top_m });
      }
    });
    return spans;
  });
}

/** The parts of the line from `a` to `b` inside a polygon, as fractions of the length of the line. */
function insideParts(a: EastNorth, b: EastNorth, ring: readonly EastNorth[]): [number, number][] {
  const [east_m, north_m] = [b.east_m - a.east_m, b.north_m - a.north_m];
  const crossings = [0, 1];
  ring.forEach((from, i) => {
    const to = ring[(i + 1) % ring.length] ?? from;
    const [side_e, side_n] = [to.east_m - from.east_m, to.north_m - from.north_m];
    const crossProduct = east_m * side_n - north_m * side_e;
    if (crossProduct === 0) return;
    const [offset_e, offset_n] = [from.east_m - a.east_m, from.north_m - a.north_m];
    const lineFraction = (offset_e * side_n - offset_n * side_e) / crossProduct;
    const sideFraction = (offset_e * north_m - offset_n * east_m) / crossProduct;
    if (lineFraction > 0 && lineFraction < 1 && sideFraction >= 0 && sideFraction <= 1) crossings.push(lineFraction);
  });
  crossings.sort((a, b) => a - b);
  return crossings.slice(1).flatMap((last, i): [number, number][] => {
    const first = crossings[i] ?? 0;
    const middle = (first + last) / 2;
    return last > first && isInside({ east_m: a.east_m + middle * east_m, north_m: a.north_m + middle * north_m }, ring) ? [[first, last]] : [];
  });
}

/** Whether a position is inside a polygon (even-odd rule). */
function isInside({ east_m, north_m }: EastNorth, ring: readonly EastNorth[]): boolean {
  return ring.reduce((inside, from, i) => {
    const to = ring[(i + 1) % ring.length] ?? from;
    const crosses = from.north_m > north_m !== to.north_m > north_m;
    const crossing_east_m = from.east_m + ((north_m - from.north_m) / (to.north_m - from.north_m)) * (to.east_m - from.east_m);
    return crosses && east_m < crossing_east_m ? !inside : inside;
  }, false);
}
