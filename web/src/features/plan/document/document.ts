/** The document of a waypoint plan (`docs/missions.md`) and the positions of its parts. */

import type { components } from '../../../api/schema';
import { userSettings } from '../../../app/settings.svelte';
import type { GeoPosition } from '../../../vehicle/geo';

type Schemas = components['schemas'];

export type Altitude = Readonly<Schemas['Altitude']>;
export type AltitudeReference = Altitude['reference'];
export type ItemKind = Schemas['Plan']['items'][number]['kind'];

/** A mission item. The further fields depend on `kind`; `fields.ts` reads them by name. */
export interface Item {
  readonly kind: ItemKind;
  readonly lat_deg?: number;
  readonly lon_deg?: number;
  readonly altitude?: Altitude;
  /** The mission items of a pattern, as they are flown. */
  readonly items?: readonly Item[];
  /** Geometry and values of a pattern. */
  readonly pattern?: Pattern;
  /** Key of the values that the items of a pattern were made from; empty: `pattern` has been changed since. */
  readonly items_key?: string;
  readonly [field: string]: unknown;
}

export type Pattern = Schemas['PatternItem']['pattern'];
/** A pattern in the plan: one row with several mission items, which follow from its values. */
export type PatternItem = Item & { readonly kind: 'pattern'; readonly pattern: Pattern; readonly items: readonly Item[] };
export type PlacedItem = Item & GeoPosition & { readonly altitude: Altitude };
export type PlannedHome = Readonly<Schemas['HomePosition']>;
export type FenceCircle = Readonly<Schemas['FenceCircle']>;
export type FencePolygon = Readonly<Omit<Schemas['FencePolygon'], 'polygon'>> & { readonly polygon: readonly GeoPosition[] };
export type FenceZone = FenceCircle | FencePolygon;
export type Obstacle = Readonly<Omit<Schemas['Obstacle'], 'polygon' | 'name'>> & { readonly name?: string; readonly polygon: readonly GeoPosition[] };
export type RallyPoint = Readonly<Schemas['RallyPoint']>;

/** The areas of a waypoint plan or an offboard mission: geofence and obstacles. */
export interface DocumentAreas {
  readonly fence: readonly FenceZone[];
  /** Older documents do not have this field. */
  readonly obstacles?: readonly Obstacle[];
}

export function obstaclesOf(document: DocumentAreas): readonly Obstacle[] {
  return document.obstacles ?? [];
}

export type Plan = Readonly<Required<Omit<Schemas['Plan'], 'items' | 'fence' | 'rally_points' | 'obstacles'>>> &
  DocumentAreas & {
    readonly items: readonly Item[];
    readonly rally_points: readonly RallyPoint[];
  };

export const EMPTY_PLAN: Plan = {
  format: 'offboard-gcs-plan',
  version: 1,
  planned_home: null,
  cruise_speed_m_s: null,
  hover_speed_m_s: null,
  items: [],
  fence: [],
  obstacles: [],
  rally_points: [],
  original: null,
};

/** Altitude of the first items of a plan. */
export function defaultAltitude(): Altitude {
  return { value_m: userSettings.get('default_altitudes')?.plan_m ?? 30, reference: 'home' };
}

export function isPlaced(item: Item): item is PlacedItem {
  return item.lat_deg !== undefined && item.lon_deg !== undefined && item.altitude !== undefined;
}

export function isPatternItem(item: Item | undefined): item is PatternItem {
  return item?.kind === 'pattern' && item.pattern !== undefined;
}

/** Whether a row stands for several mission items. */
export function isGroup(item: Item | undefined): boolean {
  return item?.kind === 'pattern' || item?.kind === 'complex';
}

/** The mission items of a row. */
export function itemsOfRow(item: Item): readonly Item[] {
  return isGroup(item) ? (item.items ?? []) : [item];
}

/** Kinds of items whose position is a target of the camera; the vehicle does not fly to this position. */
export const ROI_KINDS: ReadonlySet<ItemKind> = new Set(['roi_location', 'roi']);

export function isFlownTo(item: Item): item is PlacedItem {
  return isPlaced(item) && !ROI_KINDS.has(item.kind);
}

/** The first position of a pattern's path: where its number is on the map, and what is dragged to move it. */
export function anchorOf(item: PatternItem): PlacedItem | null {
  return item.items.find(isFlownTo) ?? null;
}

/** A simple item with its row in the plan. All items of a pattern have the same row. */
export interface RowItem {
  readonly row: number;
  readonly item: Item;
}

export function simpleItems(plan: Plan): RowItem[] {
  return plan.items.flatMap((item, row) => itemsOfRow(item).map((inner) => ({ row, item: inner })));
}

/** The items that the vehicle flies to, in the order of their rows, without the repetitions of jumps. */
export function flownItems(plan: Plan): (RowItem & { item: PlacedItem })[] {
  return simpleItems(plan).filter((entry): entry is RowItem & { item: PlacedItem } => isFlownTo(entry.item));
}

/** Altitude above home [m]; null if it cannot be computed. */
export function alt_home_m(altitude: Altitude, home: PlannedHome | null): number | null {
  if (altitude.reference === 'home') return altitude.value_m;
  const amsl_m = altitude.reference === 'amsl' ? altitude.value_m : (altitude.resolved_amsl_m ?? null);
  return amsl_m === null || home === null ? null : amsl_m - home.alt_amsl_m;
}

/** Altitude AMSL [m]; an altitude above terrain without a resolved altitude counts as an altitude above home. */
export function alt_amsl_m(altitude: Altitude, home_amsl_m: number): number {
  if (altitude.reference === 'amsl') return altitude.value_m;
  return (altitude.reference === 'terrain' ? altitude.resolved_amsl_m : null) ?? home_amsl_m + altitude.value_m;
}

/** A part of a plan that can be selected and dragged. */
export type PartRef =
  | { readonly type: 'item'; readonly row: number }
  | { readonly type: 'corner'; readonly zone: number; readonly corner: number }
  | { readonly type: 'circle'; readonly zone: number }
  | { readonly type: 'obstacle'; readonly index: number; readonly corner: number }
  | { readonly type: 'rally'; readonly index: number }
  | { readonly type: 'home' };

/** The part with this id, for example `item:3`, `corner:0:2` or `home`; null for any other id. */
export function partRefOf(id: string): PartRef | null {
  const [type, first, second] = id.split(':');
  const [a, b] = [Number(first), Number(second)];
  if (type === 'item') return { type, row: a };
  if (type === 'corner') return { type, zone: a, corner: b };
  if (type === 'circle') return { type, zone: a };
  if (type === 'obstacle') return { type, index: a, corner: b };
  if (type === 'rally') return { type, index: a };
  return type === 'home' ? { type } : null;
}

/** Position of the point with this id; null if the point has no position or no longer exists. */
export function positionOf(plan: Plan, id: string): GeoPosition | null {
  const ref = partRefOf(id);
  if (ref === null) return null;
  if (ref.type === 'item') {
    const item = plan.items[ref.row];
    return item === undefined ? null : isPatternItem(item) ? anchorOf(item) : isPlaced(item) ? item : null;
  }
  if (ref.type === 'home') return plan.planned_home;
  if (ref.type === 'rally') return plan.rally_points[ref.index] ?? null;
  return areaPositionOf(plan, ref);
}

/** Position of a part of the geofence or of an obstacle; null for any other part, or if the part no longer exists. */
export function areaPositionOf(document: DocumentAreas, ref: PartRef | null): GeoPosition | null {
  if (ref?.type === 'obstacle') return obstaclesOf(document)[ref.index]?.polygon[ref.corner] ?? null;
  if (ref?.type !== 'corner' && ref?.type !== 'circle') return null;
  const zone = document.fence[ref.zone];
  if (ref.type === 'circle') return zone?.shape === 'circle' ? zone.center : null;
  return zone?.shape === 'polygon' ? (zone.polygon[ref.corner] ?? null) : null;
}

/** All positions of the geofence and the obstacles. */
export function areaPositions(document: DocumentAreas): GeoPosition[] {
  const fencePositions = document.fence.flatMap((zone) => (zone.shape === 'polygon' ? zone.polygon : [zone.center]));
  return [...fencePositions, ...obstaclesOf(document).flatMap((obstacle) => obstacle.polygon)];
}

/** All positions of the plan, to fit them into the view. */
export function allPositions(plan: Plan): GeoPosition[] {
  const itemPositions = simpleItems(plan).flatMap(({ item }) => (isPlaced(item) ? [item as GeoPosition] : []));
  return [...(plan.planned_home === null ? [] : [plan.planned_home]), ...itemPositions, ...areaPositions(plan), ...plan.rally_points];
}

/** Altitude for a new item: that of the last flown item before the row, or else of the first flown item, or else the default. */
export function altitudeForNewItem(plan: Plan, row: number): Altitude {
  const neighbour = plan.items.slice(0, row).reverse().find(isFlownTo) ?? plan.items.find(isFlownTo);
  const altitude = neighbour?.altitude ?? defaultAltitude();
  return { value_m: altitude.value_m, reference: altitude.reference };
}

const MAX_STATES = 300;

export interface History<T> {
  readonly past: readonly T[];
  readonly present: T;
  readonly future: readonly T[];
  /** Changes of one gesture or one field have the same group and are undone together. */
  readonly group: string | null;
}

export function begin<T>(present: T): History<T> {
  return { past: [], present, future: [], group: null };
}

/** @param group null: the change is undone alone. */
export function change<T>(history: History<T>, next: T, group: string | null = null): History<T> {
  if (next === history.present) return history;
  const isSameGroup = group !== null && group === history.group;
  return { past: isSameGroup ? history.past : [...history.past, history.present].slice(-MAX_STATES), present: next, future: [], group };
}

/** Completes the present state without a new one, for example with what the server made of it. */
export function amend<T>(history: History<T>, present: T): History<T> {
  return { ...history, present };
}

/** Ends a group: the next change is undone separately. */
export function endGroup<T>(history: History<T>): History<T> {
  return history.group === null ? history : { ...history, group: null };
}

export function undo<T>(history: History<T>): History<T> {
  const previous = history.past.at(-1);
  if (previous === undefined) return history;
  return { past: history.past.slice(0, -1), present: previous, future: [history.present, ...history.future], group: null };
}

export function redo<T>(history: History<T>): History<T> {
  const [next, ...future] = history.future;
  if (next === undefined) return history;
  return { past: [...history.past, history.present], present: next, future, group: null };
}

/** Removes the changes of a cancelled gesture. */
export function cancelGroup<T>(history: History<T>, group: string): History<T> {
  return history.group === group ? { ...undo(history), future: [] } : history;
}
