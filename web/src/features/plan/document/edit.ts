/** Edits of a waypoint plan. Pure: each function returns a new plan. */

import { BOUNDS } from '../../../api/bounds';
import type { LayerPosition } from '../../../app/map-layers.svelte';
import { eastNorth, positionAt, type GeoPosition } from '../../../vehicle/geo';
import {
  isFlownTo,
  isPatternItem,
  isPlaced,
  itemsOfRow,
  obstaclesOf,
  partRefOf,
  type Altitude,
  type FenceZone,
  type Item,
  type Obstacle,
  type Plan,
  type PlannedHome,
  type PartRef,
  type RallyPoint,
  type DocumentAreas,
} from './document';
import { movePattern, raisePattern } from './pattern-items';

function replaceAt<T>(list: readonly T[], index: number, next: T): T[] {
  return list.map((value, i) => (i === index ? next : value));
}

function latLon({ lat_deg, lon_deg }: GeoPosition): GeoPosition {
  return { lat_deg, lon_deg };
}

/**
 * Changes these fields of an item. The field `original` of an imported item contains its text in the file, with fields
 * that this editor does not know; the export writes the changed values into this text.
 */
export function setItem(plan: Plan, row: number, fields: Readonly<Record<string, unknown>>): Plan {
  const item = plan.items[row];
  return item === undefined ? plan : { ...plan, items: replaceAt(plan.items, row, { ...item, ...fields }) };
}

export function setZone<D extends DocumentAreas>(plan: D, index: number, fields: Partial<FenceZone>): D {
  const zone = plan.fence[index];
  return zone === undefined ? plan : { ...plan, fence: replaceAt(plan.fence, index, { ...zone, ...fields } as FenceZone) };
}

export function setObstacle<D extends DocumentAreas>(plan: D, index: number, fields: Partial<Obstacle>): D {
  const obstacle = obstaclesOf(plan)[index];
  return obstacle === undefined ? plan : { ...plan, obstacles: replaceAt(obstaclesOf(plan), index, { ...obstacle, ...fields }) };
}

export function addObstacle<D extends DocumentAreas>(plan: D, obstacle: Obstacle): D {
  return { ...plan, obstacles: [...obstaclesOf(plan), { ...obstacle, polygon: obstacle.polygon.map(latLon) }] };
}

/** Moves the point with this id. */
export function movePoint(plan: Plan, id: string, position: GeoPosition): Plan {
  const ref = partRefOf(id);
  const target = latLon(position);
  if (ref === null) return plan;
  if (ref.type === 'item') {
    const item = plan.items[ref.row];
    if (isPatternItem(item)) return replaceRows(plan, ref.row, 1, [movePattern(item, target)]);
    return item !== undefined && isPlaced(item) ? setItem(plan, ref.row, { ...target, altitude: withoutResolvedAltitude(item.altitude) }) : plan;
  }
  if (ref.type === 'rally') {
    const point = plan.rally_points[ref.index];
    return point === undefined
      ? plan
      : { ...plan, rally_points: replaceAt(plan.rally_points, ref.index, { ...point, ...target, altitude: withoutResolvedAltitude(point.altitude) }) };
  }
  return moveHomeOrArea(plan, id, position);
}

export const ALTITUDE_LIMITS_M = BOUNDS.Altitude.value_m;

/** Changes the altitude of an item or a rally point by `by_m`; other parts have no altitude. */
export function raisePoint(plan: Plan, id: string, by_m: number): Plan {
  const ref = partRefOf(id);
  const item = ref?.type === 'item' ? plan.items[ref.row] : undefined;
  if (ref?.type === 'item' && item !== undefined && isPlaced(item)) return setItem(plan, ref.row, { altitude: withAltitudeChange(item.altitude, by_m) });
  if (ref?.type === 'item' && isPatternItem(item)) return setItem(plan, ref.row, raisePattern(item, by_m));
  const point = ref?.type === 'rally' ? plan.rally_points[ref.index] : undefined;
  if (ref?.type !== 'rally' || point === undefined) return plan;
  return {
    ...plan,
    rally_points: replaceAt(plan.rally_points, ref.index, { ...point, altitude: withAltitudeChange(point.altitude, by_m) } satisfies RallyPoint),
  };
}

export function withAltitudeChange(altitude: Altitude, by_m: number): Altitude {
  const value_m = Number(Math.max(ALTITUDE_LIMITS_M.min, Math.min(altitude.value_m + by_m, ALTITUDE_LIMITS_M.max)).toFixed(2));
  const resolved_amsl_m = altitude.resolved_amsl_m ?? null;
  return resolved_amsl_m === null ? { ...altitude, value_m } : { ...altitude, value_m, resolved_amsl_m: resolved_amsl_m + value_m - altitude.value_m };
}

/** Removes the resolved terrain altitude, because the terrain differs at another position. */
export function withoutResolvedAltitude(altitude: Altitude): Altitude {
  return altitude.reference === 'terrain' ? { ...altitude, resolved_amsl_m: null } : altitude;
}

/** Moves home, a part of the geofence, or a corner of an obstacle. */
export function moveHomeOrArea<D extends DocumentAreas>(plan: D, id: string, position: GeoPosition): D {
  const ref = partRefOf(id);
  const target = latLon(position);
  if (ref?.type === 'home') {
    const field = 'planned_home' in plan ? 'planned_home' : 'home';
    const home = (plan as Readonly<Record<string, unknown>>)[field] as PlannedHome | null | undefined;
    return home == null ? plan : { ...plan, [field]: { ...home, ...target } };
  }
  if (ref?.type === 'obstacle') {
    const obstacle = obstaclesOf(plan)[ref.index];
    return obstacle === undefined ? plan : setObstacle(plan, ref.index, { polygon: replaceAt(obstacle.polygon, ref.corner, target) });
  }
  if (ref?.type !== 'corner' && ref?.type !== 'circle') return plan;
  const zone = plan.fence[ref.zone];
  if (zone?.shape === 'circle' && ref.type === 'circle') return setZone(plan, ref.zone, { center: target });
  if (zone?.shape === 'polygon' && ref.type === 'corner') return setZone(plan, ref.zone, { polygon: replaceAt(zone.polygon, ref.corner, target) });
  return plan;
}

export function insertItem(plan: Plan, row: number, item: Item): Plan {
  return replaceRows(plan, row, 0, [item]);
}

/**
 * Replaces some rows by others; jumps keep their targets.
 * @param targetsAreNew inserted jumps already have their new targets.
 */
export function replaceRows(plan: Plan, row: number, count: number, items: readonly Item[], targetsAreNew = count === 0): Plan {
  const next = [...plan.items.slice(0, row), ...items, ...plan.items.slice(row + count)];
  const inserted = new Set(items.map((_, i) => row + i));
  const newRow = (old: number): number => (old < row ? old : old < row + count && items.length > 0 ? row : Math.max(row, old + items.length - count));
  return retarget(plan, next, newRow, targetsAreNew ? inserted : new Set());
}

/** Inserts copies of items after the selection. @returns the plan and the rows of the copies. */
export function pasteItems(plan: Plan, selected: readonly string[], items: readonly Item[]): { plan: Plan; rows: number[] } {
  const row = insertionRow(plan, selected);
  return { plan: replaceRows(plan, row, 0, items, false), rows: items.map((_, i) => row + i) };
}

/** Exchanges the rows so that the vehicle flies to them in the opposite order; the rows between them stay. */
export function reverseRows(plan: Plan, rows: readonly number[]): Plan {
  const order = [...rows].sort((a, b) => a - b);
  const opposite = new Map(order.map((row, i) => [row, order[order.length - 1 - i] ?? row]));
  const oldRow = (row: number): number => opposite.get(row) ?? row;
  const items = plan.items.flatMap((_, row) => plan.items[oldRow(row)] ?? []);
  return retarget(plan, items, oldRow);
}

/** Changes the altitudes of the rows that are flown to by `by_m`; a landing and positions for the camera stay. */
export function shiftAltitudes(plan: Plan, rows: readonly number[], by_m: number): Plan {
  const raised = rows.filter((row) => hasFlightAltitude(plan.items[row]));
  return raised.reduce((next, row) => raisePoint(next, `item:${row}`, by_m), plan);
}

export function hasFlightAltitude(item: Item | undefined): boolean {
  return item !== undefined && item.kind !== 'land' && (isPatternItem(item) || isFlownTo(item));
}

/** Replaces a pattern by its mission items, which are then ordinary ones. */
export function takeApart(plan: Plan, row: number): Plan {
  const item = plan.items[row];
  return isPatternItem(item) ? replaceRows(plan, row, 1, item.items) : plan;
}

/** Kinds of items that end the flight; no item is added after them. */
export const FLIGHT_END_KINDS: ReadonlySet<Item['kind']> = new Set(['land', 'return_home']);

/** Row at which items are inserted: after the selected rows, or without a selection at the end, but before a final landing or return. */
export function insertionRow(plan: Plan, selected: readonly string[]): number {
  const { items } = plan;
  const last = items.at(-1);
  const end = last !== undefined && FLIGHT_END_KINDS.has(last.kind) ? items.length - 1 : items.length;
  const rows = selected.map(partRefOf).flatMap((ref) => (ref?.type === 'item' ? [ref.row] : []));
  return rows.length > 0 ? Math.min(Math.max(...rows) + 1, end) : end;
}

/** Inserts several items, for example those of a pattern; jumps keep their targets. */
export function insertItems(plan: Plan, row: number, items: readonly Item[]): Plan {
  return replaceRows(plan, row, 0, items);
}

export function insertCorner<D extends DocumentAreas>(plan: D, index: number, corner: number, position: GeoPosition): D {
  const zone = plan.fence[index];
  if (zone?.shape !== 'polygon') return plan;
  return setZone(plan, index, { polygon: [...zone.polygon.slice(0, corner), latLon(position), ...zone.polygon.slice(corner)] });
}

export function insertObstacleCorner<D extends DocumentAreas>(plan: D, index: number, corner: number, position: GeoPosition): D {
  const obstacle = obstaclesOf(plan)[index];
  if (obstacle === undefined) return plan;
  return setObstacle(plan, index, { polygon: [...obstacle.polygon.slice(0, corner), latLon(position), ...obstacle.polygon.slice(corner)] });
}

/** The midpoint of two positions, at which a point can be inserted. */
export function midpoint(a: LayerPosition, b: LayerPosition): LayerPosition {
  const { east_m, north_m } = eastNorth(a, b);
  const middle = positionAt(a, { east_m: east_m / 2, north_m: north_m / 2 });
  return a.alt_amsl_m === undefined || b.alt_amsl_m === undefined ? middle : { ...middle, alt_amsl_m: (a.alt_amsl_m + b.alt_amsl_m) / 2 };
}

/** Removes the selected parts. A polygon with fewer than three remaining corners is removed completely. */
export function remove(plan: Plan, ids: readonly string[]): Plan {
  const refs = ids.flatMap((id) => partRefOf(id) ?? []);
  const rows = new Set(refs.flatMap((ref) => (ref.type === 'item' ? [ref.row] : [])));
  const rallies = new Set(refs.flatMap((ref) => (ref.type === 'rally' ? [ref.index] : [])));
  const remainingRows = plan.items.map((_, row) => row).filter((row) => !rows.has(row));
  const items = plan.items.filter((_, row) => !rows.has(row));
  // A jump to a removed item now goes to the next remaining item.
  const next = retarget(plan, items, (target) => remainingRows.filter((row) => row < target).length);
  return { ...removeHomeAndAreas(next, ids), rally_points: plan.rally_points.filter((_, index) => !rallies.has(index)) };
}

/** Removes home, corners and circles of the geofence, and corners of obstacles. */
export function removeHomeAndAreas<D extends DocumentAreas>(plan: D, ids: readonly string[]): D {
  const refs = ids.flatMap((id) => partRefOf(id) ?? []);
  const circles = new Set(refs.flatMap((ref) => (ref.type === 'circle' ? [ref.zone] : [])));
  const fence = plan.fence.flatMap((zone, index): FenceZone[] => {
    if (circles.has(index)) return [];
    if (zone.shape === 'circle') return [zone];
    return withoutCorners(zone, (ref, corner) => ref.type === 'corner' && ref.zone === index && ref.corner === corner, refs);
  });
  const obstacles = obstaclesOf(plan).flatMap((obstacle, index) =>
    withoutCorners(obstacle, (ref, corner) => ref.type === 'obstacle' && ref.index === index && ref.corner === corner, refs),
  );
  const home = refs.some((ref) => ref.type === 'home') ? { ['planned_home' in plan ? 'planned_home' : 'home']: null } : {};
  return { ...plan, ...home, fence, ...(obstaclesOf(plan).length === 0 ? {} : { obstacles }) };
}

/** The part without the selected corners, as a list; the list is empty if fewer than three corners remain. */
function withoutCorners<P extends { readonly polygon: readonly GeoPosition[] }>(
  part: P,
  refersTo: (ref: PartRef, corner: number) => boolean,
  refs: readonly PartRef[],
): P[] {
  const polygon = part.polygon.filter((_, corner) => !refs.some((ref) => refersTo(ref, corner)));
  return polygon.length === part.polygon.length ? [part] : polygon.length < 3 ? [] : [{ ...part, polygon }];
}

export function removeObstacle<D extends DocumentAreas>(plan: D, index: number): D {
  return { ...plan, obstacles: obstaclesOf(plan).filter((_, i) => i !== index) };
}

export function removeZone<D extends DocumentAreas>(plan: D, index: number): D {
  return { ...plan, fence: plan.fence.filter((_, i) => i !== index) };
}

/** Moves the rows to the place before `targetRow`, a row of the unchanged plan. The moved rows keep their order. @returns the plan and the new rows. */
export function reorder(plan: Plan, rows: readonly number[], targetRow: number): { plan: Plan; rows: number[] } {
  const movedRowSet = new Set(rows);
  const allRows = plan.items.map((_, row) => row);
  const rowsBefore = allRows.filter((row) => row < targetRow && !movedRowSet.has(row));
  const rowsAfter = allRows.filter((row) => row >= targetRow && !movedRowSet.has(row));
  const movedRows = allRows.filter((row) => movedRowSet.has(row));
  const newOrder = [...rowsBefore, ...movedRows, ...rowsAfter];
  const items = newOrder.flatMap((row) => plan.items[row] ?? []);
  const result = retarget(plan, items, (target) => newOrder.indexOf(target));
  return { plan: result, rows: movedRows.map((row) => newOrder.indexOf(row)) };
}

/**
 * The plan with other rows, whose jumps have the same targets. A target is the index of a mission item; a pattern is one
 * row with several. A jump into a pattern goes to the same item of it, or if the pattern has changed to its first one.
 * @param newRow the new row of an old row.
 * @param untouched new rows whose jumps already have their new targets.
 */
function retarget(plan: Plan, items: readonly Item[], newRow: (row: number) => number, untouched: ReadonlySet<number> = new Set()): Plan {
  if (!items.some((item) => item.kind === 'jump')) return { ...plan, items };
  const [oldStarts, newStarts] = [startsOf(plan.items), startsOf(items)];
  const total = oldStarts.at(-1) ?? 0;
  const newTarget = (target: number): number => {
    if (target >= total) return target;
    const row = oldStarts.filter((start) => start <= target).length - 1;
    const [before, after] = [plan.items[row], items[newRow(row)]];
    const keepsItem = before !== undefined && after !== undefined && itemsOfRow(before).length === itemsOfRow(after).length;
    return (newStarts[newRow(row)] ?? 0) + (keepsItem ? target - (oldStarts[row] ?? 0) : 0);
  };
  const next = items.map((item, row) => {
    const target = item['target_index'];
    return item.kind === 'jump' && !untouched.has(row) && typeof target === 'number' ? { ...item, target_index: newTarget(target) } : item;
  });
  return { ...plan, items: next };
}

/** Index of each row's first mission item, and at the end their number. */
function startsOf(items: readonly Item[]): number[] {
  const starts = [0];
  let count = 0;
  for (const item of items) starts.push((count += itemsOfRow(item).length));
  return starts;
}
