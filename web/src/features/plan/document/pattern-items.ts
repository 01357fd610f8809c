/** Changes of a pattern in a plan. The server makes its new items (`patterns/updates.svelte.ts`). Pure functions. */

import { eastNorth, positionAt, type EastNorth, type GeoPosition } from '../../../vehicle/geo';
import { anchorOf, isPatternItem, isPlaced, type Altitude, type Item, type Pattern, type PatternItem } from './document';
import { withAltitudeChange, withoutResolvedAltitude } from './edit';

/** The pattern with other values; its items belong to the earlier ones until the server has made new ones. */
export function withPattern(item: PatternItem, pattern: Pattern): PatternItem {
  return { ...item, pattern, items_key: '' };
}

/** Whether the items belong to earlier values of the pattern. */
export function isStale(item: PatternItem): boolean {
  return item.items_key === '' || item.items_key === undefined;
}

/** The pattern with the items that the server has made from its values; null: the answer contains none. */
export function withItems(item: PatternItem, made: Item | undefined): PatternItem | null {
  return isPatternItem(made) ? { ...item, items: made.items, items_key: made.items_key ?? '' } : null;
}

/** The pattern with the first position of its path at another place. */
export function movePattern(item: PatternItem, to: GeoPosition): PatternItem {
  const anchor = anchorOf(item);
  if (anchor === null) return item;
  const offset = eastNorth(anchor, to);
  const items = item.items.map((inner): Item =>
    isPlaced(inner) ? { ...inner, ...moved(inner, offset), altitude: withoutResolvedAltitude(inner.altitude) } : inner,
  );
  return { ...withPattern(item, withMovedPoints(item.pattern, offset)), items };
}

function moved(point: GeoPosition, offset: EastNorth): GeoPosition {
  const { lat_deg, lon_deg } = positionAt(point, offset);
  return { lat_deg, lon_deg };
}

function withMovedPoints(pattern: Pattern, offset: EastNorth): Pattern {
  const all = (points: readonly GeoPosition[]): GeoPosition[] => points.map((point) => moved(point, offset));
  switch (pattern.kind) {
    case 'survey':
      return { ...pattern, outer: all(pattern.outer), holes: (pattern.holes ?? []).map(all) };
    case 'perimeter':
      return { ...pattern, outer: all(pattern.outer) };
    case 'corridor':
      return { ...pattern, points: all(pattern.points) };
    case 'orbit':
      return { ...pattern, center: moved(pattern.center, offset) };
    case 'structure':
      return { ...pattern, outline: all(pattern.outline) };
  }
}

/** The altitude of a pattern's path; of a structure scan, of the structure's base. */
export function altitudeOf(pattern: Pattern): Altitude {
  return pattern.kind === 'structure' ? pattern.base : pattern.altitude;
}

/** The pattern higher by `by_m`. A camera whose distance to the ground is the altitude is then farther away. */
export function raisePattern(item: PatternItem, by_m: number): PatternItem {
  const raised = (altitude: Altitude): Altitude => withAltitudeChange(altitude, by_m);
  const items = item.items.map((inner): Item => (isPlaced(inner) ? { ...inner, altitude: raised(inner.altitude) } : inner));
  return { ...withPattern(item, raisedPattern(item.pattern, raised)), items };
}

function raisedPattern(pattern: Pattern, raised: (altitude: Altitude) => Altitude): Pattern {
  if (pattern.kind === 'structure')
    return { ...pattern, base: raised(pattern.base), ...(pattern.entrance == null ? {} : { entrance: raised(pattern.entrance) }) };
  const altitude = raised(pattern.altitude);
  if (pattern.kind === 'perimeter' || pattern.kind === 'orbit') return { ...pattern, altitude };
  const seesGround = pattern.altitude.reference !== 'amsl' && pattern.coverage.distance_m === pattern.altitude.value_m && altitude.value_m > 0;
  return { ...pattern, altitude, coverage: seesGround ? { ...pattern.coverage, distance_m: altitude.value_m } : pattern.coverage };
}

/** The points of a pattern: the outline, the line or the centre first, then the holes. */
export function ringsOf(pattern: Pattern): GeoPosition[][] {
  switch (pattern.kind) {
    case 'survey':
      return [[...pattern.outer], ...(pattern.holes ?? []).map((hole) => [...hole])];
    case 'perimeter':
      return [[...pattern.outer]];
    case 'corridor':
      return [[...pattern.points]];
    case 'orbit':
      return [[pattern.center]];
    case 'structure':
      return [[...pattern.outline]];
  }
}
