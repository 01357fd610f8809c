/** The grid around the reference position (normally home); its spacing depends on the zoom. */

import { roundLengthAbove_m, roundLengthText } from '../../ui/format';
import { eastNorth, fromPixel, pixelsPerMetre, positionAt, toPixel, type EastNorth, type MapView, type GeoPosition } from '../../vehicle/geo';
import type { DistanceReference } from './map-model';

/** Minimum side of a small cell on the screen [px]; the next larger spacing is ten times as long. */
const MIN_CELL_PX = 34;
/** The grid ends at this distance from the reference [m], because a flat grid is too inaccurate farther away. */
const MAX_GRID_M = 500_000;
const MAX_LINES = 400;

/** Side of a small cell [m]: the smallest power of ten of the unit that is wide enough on the screen, at least 1. Every tenth line is strong. */
export function gridStep_m(px_per_m: number): number {
  return roundLengthAbove_m(MIN_CELL_PX / px_per_m);
}

/** A rectangle, relative to the reference position [m]. */
export interface Box {
  west_m: number;
  east_m: number;
  south_m: number;
  north_m: number;
}

/** The smallest rectangle that contains the view. The view may be rotated. */
export function viewBox(view: MapView, reference: GeoPosition): Box {
  const corners = [
    [0, 0],
    [view.width, view.height],
    [0, view.height],
    [view.width, 0],
  ].map(([x = 0, y = 0]) => eastNorth(reference, fromPixel(view, { x, y })));
  const east = corners.map((c) => c.east_m);
  const north = corners.map((c) => c.north_m);
  return { west_m: Math.min(...east), east_m: Math.max(...east), south_m: Math.min(...north), north_m: Math.max(...north) };
}

/** The factors k for which k · `step_m` is in the range; empty if there are too many. */
function multiples(from_m: number, to_m: number, step_m: number): number[] {
  const first = Math.ceil(from_m / step_m);
  const count = Math.max(0, Math.floor(to_m / step_m) - first + 1);
  return count > MAX_LINES ? [] : Array.from({ length: count }, (_, i) => first + i);
}

export interface GridLine {
  from: GeoPosition;
  to: GeoPosition;
}

export interface Grid {
  thinLines: GridLine[];
  /** Every tenth line, and the lines through the reference. */
  strongLines: GridLine[];
}

/** The grid's lines in a box. */
export function gridLines(reference: GeoPosition, box: Box, step_m: number): Grid {
  const west_m = Math.max(box.west_m, -MAX_GRID_M);
  const east_m = Math.min(box.east_m, MAX_GRID_M);
  const south_m = Math.max(box.south_m, -MAX_GRID_M);
  const north_m = Math.min(box.north_m, MAX_GRID_M);
  const grid: Grid = { thinLines: [], strongLines: [] };
  if (west_m >= east_m || south_m >= north_m) return grid;
  const add = (k: number, from: EastNorth, to: EastNorth): unknown =>
    (k % 10 === 0 ? grid.strongLines : grid.thinLines).push({ from: positionAt(reference, from), to: positionAt(reference, to) });
  for (const k of multiples(west_m, east_m, step_m)) add(k, { east_m: k * step_m, north_m: south_m }, { east_m: k * step_m, north_m });
  for (const k of multiples(south_m, north_m, step_m)) add(k, { east_m: west_m, north_m: k * step_m }, { east_m, north_m: k * step_m });
  return grid;
}

export interface EdgeLabel {
  x: number;
  y: number;
  text: string;
}

/** Space for one label [px]. */
const LABEL_PX = 64;

/** Distances from the reference [m] at the view's top edge (east, west) and left edge (north, south); empty unless north is up. */
export function edgeLabels(view: MapView, reference: DistanceReference): EdgeLabel[] {
  if (Math.abs(Math.sin(view.up_rad)) > 0.005 || Math.cos(view.up_rad) < 0) return [];
  const px_per_m = pixelsPerMetre(view);
  const step_m = gridStep_m(px_per_m);
  const spacing_m = step_m * px_per_m >= LABEL_PX ? step_m : step_m * 10;
  const box = viewBox(view, reference);
  const farthest_m = Math.max(Math.abs(box.west_m), Math.abs(box.east_m), Math.abs(box.south_m), Math.abs(box.north_m));
  if (farthest_m > MAX_GRID_M) return [];
  const labelText = (metres: number, plus: string, minus: string): string =>
    metres === 0 ? reference.name : `${roundLengthText(Math.abs(metres))} ${metres > 0 ? plus : minus}`;
  const labels: EdgeLabel[] = [];
  for (const k of multiples(box.west_m, box.east_m, spacing_m)) {
    labels.push({ x: toPixel(view, positionAt(reference, { east_m: k * spacing_m, north_m: 0 })).x, y: 0, text: labelText(k * spacing_m, 'E', 'W') });
  }
  for (const k of multiples(box.south_m, box.north_m, spacing_m)) {
    labels.push({ x: 0, y: toPixel(view, positionAt(reference, { east_m: 0, north_m: k * spacing_m })).y, text: labelText(k * spacing_m, 'N', 'S') });
  }
  return labels;
}
