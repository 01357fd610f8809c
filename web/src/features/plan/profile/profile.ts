/** The altitude profile along the path. Pure functions. */

import { fromUnit, stepIn } from '../../../ui/units';
import { groundDistance_m, positionAt, type GeoPosition, eastNorth, type EastNorth } from '../../../vehicle/geo';
import { alt_home_m, obstaclesOf, flownItems, type Plan, type PlannedHome, type DocumentAreas, type Obstacle } from '../document/document';
import type { CompiledFlight } from '../offboard/mission';

export interface ProfilePoint {
  /** Row of the item, or −1 for home. In a mission: index of the point. */
  readonly row: number;
  /** Id of the item or step; null: none. In a mission, only the first point of a step has an id. */
  readonly id: string | null;
  /** Time since the start of the flight; null if it is not known. */
  readonly t_s?: number;
  /** Horizontal distance from the first point. */
  readonly distance_m: number;
  /** Altitude above home, or above the start of a mission; null if it cannot be computed. */
  readonly alt_home_m: number | null;
  /** Geographic position; null if the origin of the local frame is unknown. */
  readonly at: GeoPosition | null;
}

export interface Profile {
  readonly points: readonly ProfilePoint[];
  readonly obstacles: readonly ObstacleSpan[];
  readonly length_m: number;
  readonly top_m: number;
  readonly bottom_m: number;
}

/**
 * Terrain below the path, from the server's check. Each entry: distance along the path [m], and terrain altitude above
 * home, or above the start of a mission [m]; the altitude is null if it is not known.
 */
export type Ground = readonly (readonly [number, number | null])[];

/** The scale of the plot ends at multiples of about this altitude [m], round in the chosen unit. */
const SCALE_STEP_M = 10;

/** Profile of a waypoint plan, from the planned home, if there is one, through all items that the vehicle flies to. */
export function profile(plan: Plan, ground: Ground = []): Profile {
  let distance_m = 0;
  const home = plan.planned_home;
  const items = flownItems(plan);
  const points: ProfilePoint[] = home === null || items.length === 0 ? [] : [{ row: -1, id: null, distance_m: 0, alt_home_m: 0, at: home }];
  items.forEach(({ row, item }, i) => {
    const previous = items[i - 1]?.item ?? home;
    if (previous !== null && previous !== undefined) distance_m += groundDistance_m(previous, item);
    points.push({ row, id: `item:${row}`, distance_m, alt_home_m: alt_home_m(item.altitude, home), at: item });
  });
  return completeProfile(points, ground, plan, home);
}

/**
 * Profile of a mission: altitudes above the start, along the longest path through the branches.
 * @param mission gives the obstacles and home.
 */
export function missionProfile(flight: CompiledFlight, ground: Ground, mission: DocumentAreas & { readonly home?: PlannedHome | null }): Profile {
  const points: ProfilePoint[] = [];
  const start_down_m = flight.start_ned_m[2] ?? 0;
  let [distance_m, lastPlace] = [0, ''];
  let lastPoint: readonly number[] | null = null;
  for (const leg of flight.legs.filter(({ main }) => main))
    leg.points.forEach((point, i) => {
      const [t_s, north_m, east_m, down_m] = point;
      if (lastPoint !== null) distance_m += Math.hypot(north_m - (lastPoint[1] ?? 0), east_m - (lastPoint[2] ?? 0));
      lastPoint = point;
      const beginsStep = i === 0 && leg.place !== lastPlace;
      lastPlace = leg.place;
      const at = flight.origin === null ? null : positionAt(flight.origin, { north_m, east_m });
      points.push({
        row: points.length,
        id: beginsStep ? `step:${leg.place}` : null,
        t_s: leg.start_s + t_s,
        distance_m,
        alt_home_m: start_down_m - down_m,
        at,
      });
    });
  return completeProfile(points, ground, mission, mission.home ?? null);
}

/** Adds the obstacles, the length and the range of altitudes to the points. */
function completeProfile(points: readonly ProfilePoint[], ground: Ground, document: DocumentAreas, home: PlannedHome | null): Profile {
  const path = points.flatMap(({ at, distance_m }) => (at === null ? [] : [{ at, distance_m }]));
  const obstacles = obstacleSpans(path, obstaclesOf(document), home);
  const length_m = points.at(-1)?.distance_m ?? 0;
  const altitudes_m = [
    ...points.flatMap((point) => point.alt_home_m ?? []),
    ...ground.flatMap(([, altitude_m]) => altitude_m ?? []),
    ...obstacles.map((span) => span.top_m),
  ];
  const step_m = fromUnit('height', stepIn('height', SCALE_STEP_M));
  const top_m = Math.max(step_m, Math.ceil((Math.max(0, ...altitudes_m) * 1.1) / step_m) * step_m);
  const bottom_m = Math.min(0, Math.floor(Math.min(0, ...altitudes_m) / step_m) * step_m);
  return { points, obstacles, length_m, top_m, bottom_m };
}

/** A vertex of a polyline, y downwards. */
export interface PolylinePoint {
  readonly x: number;
  readonly y: number;
  readonly id: string | null;
}

/** The parts of the profile with known altitudes, as polylines in a plot of this size [px]. */
export function polylines({ points, length_m, top_m, bottom_m }: Profile, width: number, height: number): PolylinePoint[][] {
  const parts: PolylinePoint[][] = [[]];
  for (const point of points) {
    if (point.alt_home_m === null) {
      if (parts.at(-1)?.length !== 0) parts.push([]);
      continue;
    }
    const x = length_m === 0 ? 0 : (point.distance_m / length_m) * width;
    parts.at(-1)?.push({ x, y: ((top_m - point.alt_home_m) / (top_m - bottom_m)) * height, id: point.id });
  }
  return parts.filter((part) => part.length > 0);
}

/** The known parts of the terrain as SVG path data, filled down to the lower edge of the plot. */
export function groundAreas({ length_m, top_m, bottom_m }: Profile, ground: Ground, width: number, height: number): string {
  const runs: string[][] = [[]];
  for (const [distance_m, altitude_m] of ground) {
    if (altitude_m === null) {
      if (runs.at(-1)?.length !== 0) runs.push([]);
      continue;
    }
    const x = length_m === 0 ? 0 : Math.min(1, distance_m / length_m) * width;
    runs.at(-1)?.push(`${x.toFixed(1)} ${(((top_m - altitude_m) / (top_m - bottom_m)) * height).toFixed(1)}`);
  }
  return runs
    .filter((run) => run.length > 1)
    .map((run) => `M${run[0]?.split(' ')[0]} ${height}L${run.join('L')}L${run.at(-1)?.split(' ')[0]} ${height}Z`)
    .join('');
}

/** The obstacles as SVG path data, from their tops to the lower edge of the plot; each is at least 2 pixels wide. */
export function obstacleAreas({ obstacles, length_m, top_m, bottom_m }: Profile, width: number, height: number): string {
  const scale = length_m === 0 ? 0 : width / length_m;
  return obstacles
    .map((span) => {
      const x = span.from_m * scale;
      const y = ((top_m - span.top_m) / (top_m - bottom_m)) * height;
      const width_px = Math.max(2, (span.to_m - span.from_m) * scale);
      return `M${x.toFixed(1)} ${height}V${y.toFixed(1)}h${width_px.toFixed(1)}V${height}Z`;
    })
    .join('');
}

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
