/** The mission of a vehicle on the map in flight, and how far it still is. Pure functions. */

import type { LayerContent, LayerLine, LayerPoint, LayerPosition } from '../../../app/map-layers.svelte';
import { distanceText } from '../../../ui/format';
import { groundDistance_m, positionAt, type GeoPosition } from '../../../vehicle/geo';
import { alt_amsl_m, isFlownTo, isPlaced, simpleItems, type Item, type Plan } from '../document/document';
import { areaLayer } from '../document/layer';
import { titleOf } from '../document/items';
import type { FlownPath } from '../offboard/flown-path';

const NOTHING_SELECTED: ReadonlySet<string> = new Set();

/** A position that the mission passes, with the index of its item or leg. */
interface Stop {
  readonly index: number;
  readonly at: LayerPosition;
  readonly mark: LayerPoint['mark'];
  readonly text: string;
}

/** @param current index of the item or leg in flight; null: the mission is not being flown, so nothing is faded. */
function pointOf({ index, at, mark, text }: Stop, current: number | null): LayerPoint {
  return {
    id: `mission:${index}`,
    ...at,
    mark,
    tone: 'target',
    text,
    selected: index === current,
    ...(current !== null && index < current ? { faded: true } : {}),
  };
}

/** The plan on a vehicle: numbered items, the current one bright, what was flown faded; its geofence and rally points. */
export function missionLayer(plan: Plan, home: Required<LayerPosition> | null, current: number | null): LayerContent {
  const stops = simpleItems(plan).flatMap(({ item }, index): (Stop & { isFlown: boolean })[] => {
    if (!isPlaced(item)) return [];
    const isFlown = isFlownTo(item);
    const at = { lat_deg: item.lat_deg, lon_deg: item.lon_deg, ...(home === null ? {} : { alt_amsl_m: alt_amsl_m(item.altitude, home.alt_amsl_m) }) };
    return [{ index, at, isFlown, mark: isFlown ? 'disc' : 'cross', text: isFlown ? String(index + 1) : '' }];
  });
  const path = stops.filter(({ isFlown }) => isFlown);
  const area = areaLayer(plan, NOTHING_SELECTED, null, home?.alt_amsl_m ?? 0);
  const rally = plan.rally_points.map(({ lat_deg, lon_deg }, index): LayerPoint => ({
    id: `mission-rally:${index}`,
    lat_deg,
    lon_deg,
    mark: 'disc',
    tone: 'actual',
    text: 'R',
    selected: false,
  }));
  return {
    points: [...rally, ...stops.map((stop) => pointOf(stop, current))],
    lines: [...area.lines, ...pathLines(path, current)],
    areas: area.areas,
    ...(home === null ? {} : { ground: home }),
  };
}

/** The flown part ends at the item before the current one. */
function pathLines(path: readonly Stop[], current: number | null): LayerLine[] {
  const flownCount = current === null ? 0 : path.filter(({ index }) => index < current).length;
  const line = (part: readonly Stop[], faded: boolean): LayerLine => ({
    positions: part.map(({ at }) => at),
    tone: 'target',
    style: 'solid',
    ...(faded ? { faded } : {}),
  });
  return [line(path.slice(0, flownCount), true), line(path.slice(Math.max(0, flownCount - 1)), false)].filter(({ positions }) => positions.length > 1);
}

/** The steps of an offboard mission in flight. @param place the current step: "step 3"; null: not known. */
export function offboardLayer({ origin, planned_legs }: FlownPath, place: string | null): LayerContent | null {
  if (origin === null) return null;
  const positionOf = ([, north_m = 0, east_m = 0, down_m = 0]: readonly number[]): LayerPosition => ({
    ...positionAt(origin, { north_m, east_m }),
    alt_amsl_m: origin.alt_amsl_m - down_m,
  });
  const legs = planned_legs.filter(({ main, points }) => main && points.length > 0);
  const current = legs.findIndex((leg) => leg.place === place);
  const stops = legs.flatMap(({ place: name, points }, index): Stop[] => {
    const last = points.at(-1);
    const isLastOfStep = legs[index + 1]?.place !== name;
    return last !== undefined && isLastOfStep ? [{ index, at: positionOf(last), mark: 'disc', text: name.replace(/^step /, '') }] : [];
  });
  const lines = legs.map(({ points }, index): LayerLine => ({
    positions: points.map(positionOf),
    tone: 'target',
    style: 'solid',
    ...(index < current ? { faded: true } : {}),
  }));
  const points = stops.map((stop) => ({ ...pointOf(stop, current < 0 ? null : current), selected: legs[stop.index]?.place === place }));
  return { points, lines: lines.filter(({ positions }) => positions.length > 1), areas: [], ground: origin };
}

/**
 * Distances over ground along the items, as text: to the current item, and to the last one. Null: the mission has no further
 * position. Jumps repeat items, so a plan with jumps has no distance to the last item.
 */
export function distanceLeftText(plan: Plan, current: number, position: GeoPosition | null): string | null {
  if (position === null) return null;
  const items = simpleItems(plan).map(({ item }) => item);
  const ahead = items.slice(current).filter(isFlownTo);
  const [next] = ahead;
  if (next === undefined) return null;
  const next_m = groundDistance_m(position, next);
  const left_m = ahead.reduce((sum, item, i) => sum + groundDistance_m(ahead[i - 1] ?? position, item), 0);
  const hasJump = items.slice(current).some(({ kind }) => kind === 'jump');
  return `${distanceText(next_m)} to it${hasJump || ahead.length === 1 ? '' : ` · ${distanceText(left_m)} to the last item`}`;
}

/** The items of a mission by number and title, for a list. @param plan null: only numbers are known. */
export function itemNames(plan: Plan | null, count: number): string[] {
  const items: (Item | undefined)[] = plan === null ? [] : simpleItems(plan).map(({ item }) => item);
  return Array.from({ length: count }, (_, index) => {
    const item = items[index];
    return `${index + 1}${item === undefined ? '' : ` · ${titleOf(item)}`}`;
  });
}
