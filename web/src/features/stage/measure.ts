/** Distances, bearings and the area of a line or an area on the map. Pure functions. */

import type { LayerContent } from '../../app/map-layers.svelte';
import { distanceText, heading, toDeg } from '../../ui/format';
import { bearing_rad, eastNorth, groundDistance_m, type GeoPosition } from '../../vehicle/geo';

export interface MeasuredLeg {
  readonly name: string;
  readonly length_m: number;
  /** Bearing at its start, clockwise from north [deg]. */
  readonly bearing_deg: number;
}

export interface Measured {
  readonly legs: readonly MeasuredLeg[];
  readonly total_m: number;
  /** Null: not closed, or its sides cross. */
  readonly area_m2: number | null;
  readonly sidesCross: boolean;
}

/** @param closed the last point is joined to the first. */
export function measured(points: readonly GeoPosition[], closed: boolean): Measured {
  const [first] = points;
  const path = closed && first !== undefined ? [...points, first] : points;
  const legs = path.slice(1).map((to, index): MeasuredLeg => {
    const from = path[index] ?? to;
    const end = index + 1 === points.length ? 1 : index + 2;
    return { name: `${index + 1} → ${end}`, length_m: groundDistance_m(from, to), bearing_deg: toDeg(bearing_rad(from, to)) ?? 0 };
  });
  const corners = first === undefined ? [] : points.map((point) => eastNorth(first, point));
  const cross = (a: { east_m: number; north_m: number }, b: { east_m: number; north_m: number }): number => a.east_m * b.north_m - a.north_m * b.east_m;
  const sidesCross = closed && haveCrossingSides(corners);
  const doubled_m2 = corners.reduce((sum, corner, index) => sum + cross(corner, corners[(index + 1) % corners.length] ?? corner), 0);
  const total_m = legs.reduce((sum, { length_m }) => sum + length_m, 0);
  return { legs, total_m, area_m2: closed && !sidesCross ? Math.abs(doubled_m2) / 2 : null, sidesCross };
}

interface Corner {
  readonly east_m: number;
  readonly north_m: number;
}

/** Whether two sides of a closed line cross that do not share a corner. */
function haveCrossingSides(corners: readonly Corner[]): boolean {
  const side = (a: Corner, b: Corner, c: Corner): number => (b.east_m - a.east_m) * (c.north_m - a.north_m) - (b.north_m - a.north_m) * (c.east_m - a.east_m);
  const sides = corners.map((corner, index) => [corner, corners[(index + 1) % corners.length] ?? corner] as const);
  return sides.some(([a, b], i) =>
    sides.slice(i + 2, i === 0 ? -1 : undefined).some(([c, d]) => side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0),
  );
}

export function legText({ length_m, bearing_deg }: MeasuredLeg): string {
  return `${distanceText(length_m)}, ${heading(bearing_deg)}°`;
}

/** What the map shows. A layer without points still takes the clicks. */
export function measureLayer(points: readonly GeoPosition[], closed: boolean, selected: number | null): LayerContent {
  const [first] = points;
  const ring = closed && first !== undefined ? [...points, first] : points;
  return {
    points: points.map((point, index) => ({
      ...point,
      id: `measure:${index}`,
      mark: 'disc',
      tone: 'text2',
      text: String(index + 1),
      selected: index === selected,
    })),
    lines: ring.length > 1 ? [{ positions: ring, tone: 'text2', style: 'dashed' }] : [],
    areas: closed ? [{ ring: points, tone: 'text2' }] : [],
  };
}
