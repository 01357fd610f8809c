/** The altitude profile along the path. Pure functions. */

import { groundDistance_m, positionAt, type GeoPosition } from '../../../vehicle/geo';
import { alt_home_m, obstaclesOf, flownItems, type Plan, type PlannedHome, type DocumentAreas } from '../document/document';
import type { CompiledFlight } from '../offboard/compiled-path';
import { obstacleSpans, type ObstacleSpan } from './profile-obstacles';

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

/** The scale of the plot ends at multiples of this altitude [m]. */
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
  const top_m = Math.max(SCALE_STEP_M, Math.ceil((Math.max(0, ...altitudes_m) * 1.1) / SCALE_STEP_M) * SCALE_STEP_M);
  const bottom_m = Math.min(0, Math.floor(Math.min(0, ...altitudes_m) / SCALE_STEP_M) * SCALE_STEP_M);
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
