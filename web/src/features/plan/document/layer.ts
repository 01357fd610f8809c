/** A waypoint plan as an editable map layer. */

import type { LayerArea, LayerLine, LayerContent, LayerPoint, LayerPosition, LayerSolid, Tone } from '../../../app/map-layers.svelte';
import type { GeoPosition } from '../../../vehicle/geo';
import {
  alt_amsl_m,
  isFlownTo,
  isPlaced,
  obstaclesOf,
  flownItems,
  isGroup,
  isPatternItem,
  anchorOf,
  type Altitude,
  type FenceZone,
  type Plan,
  type DocumentAreas,
} from './document';
import { midpoint } from './edit';
import { altitudeText } from './items';
import { ringsOf } from './pattern-items';

/** Above this number of flown items, midpoints are shown only beside the selection. */
const MAX_MIDPOINTS = 60;
const CIRCLE_CORNERS = 72;
const EARTH_M_PER_DEG = 111_194.9;

/**
 * Parses the id of a midpoint: `middle:ROW` between two items, `side:ZONE:CORNER` on the outline of a geofence zone,
 * `edge:OBSTACLE:CORNER` on the outline of an obstacle. ROW or CORNER is the index of the inserted point.
 */
export function parseMidpointId(id: string): { row: number } | { zone: number; corner: number } | { obstacle: number; corner: number } | null {
  const [type, a, b] = id.split(':');
  if (type === 'middle') return { row: Number(a) };
  if (type === 'edge') return { obstacle: Number(a), corner: Number(b) };
  return type === 'side' ? { zone: Number(a), corner: Number(b) } : null;
}

/** An area that is being drawn and is not yet part of the plan. */
export interface Sketch {
  readonly corners: readonly GeoPosition[];
  readonly tone: Tone;
}

/**
 * Points, lines and areas of a waypoint plan.
 * @param start position of home; altitudes above home are relative to its altitude.
 */
export function planLayer(plan: Plan, selected: ReadonlySet<string>, sketch: Sketch | null, start: Required<LayerPosition>): LayerContent {
  const withAltitude = (item: GeoPosition & { readonly altitude: Altitude }): Required<LayerPosition> => ({
    lat_deg: item.lat_deg,
    lon_deg: item.lon_deg,
    alt_amsl_m: alt_amsl_m(item.altitude, start.alt_amsl_m),
  });
  const { points, lines: areaLines, areas, solids } = areaLayer(plan, selected, sketch, start.alt_amsl_m);
  const add = pointAdder(points, selected);
  const items = flownItems(plan);
  const showsAllMidpoints = items.length <= MAX_MIDPOINTS;
  items.forEach(({ row, item }, i) => {
    const previous = items[i - 1];
    if (previous === undefined || isGroup(plan.items[row]) || previous.row === row) return;
    if (showsAllMidpoints || selected.has(`item:${row}`) || selected.has(`item:${previous.row}`))
      add(`middle:${row}`, midpoint(withAltitude(previous.item), withAltitude(item)), 'midpoint', 'target');
  });
  plan.rally_points.forEach((point, index) => add(`rally:${index}`, withAltitude(point), 'disc', 'actual', 'R', altitudeText(point.altitude)));
  if (plan.planned_home !== null) add('home', { ...plan.planned_home, alt_amsl_m: start.alt_amsl_m }, 'home', 'text2');
  plan.items.forEach((item, row) => {
    const anchor = isPatternItem(item) ? anchorOf(item) : null;
    if (anchor !== null) add(`item:${row}`, withAltitude(anchor), 'disc', 'target', String(row + 1), altitudeText(anchor.altitude));
    if (!isPlaced(item)) return;
    const isFlown = isFlownTo(item);
    add(`item:${row}`, withAltitude(item), isFlown ? 'disc' : 'cross', 'target', isFlown ? String(row + 1) : '', altitudeText(item.altitude));
  });
  return { points, lines: [...areaLines, ...outlines(plan), ...pathLines(plan, withAltitude, start), ...sketchLines(sketch)], areas, solids, ground: start };
}

/** @returns a function that adds a point to `points`. The editor can raise and lower only points that were added with a text of the altitude. */
export function pointAdder(points: LayerPoint[], selected: ReadonlySet<string>) {
  return (
    id: string,
    { lat_deg, lon_deg, alt_amsl_m: amsl_m }: LayerPosition,
    mark: LayerPoint['mark'],
    tone: Tone,
    text = '',
    pointAltitudeText?: string,
  ): void => {
    const position = { lat_deg, lon_deg, ...(amsl_m === undefined ? {} : { alt_amsl_m: amsl_m }) };
    points.push({
      id,
      ...position,
      mark,
      tone,
      text,
      selected: selected.has(id),
      ...(pointAltitudeText === undefined ? {} : { altitudeText: pointAltitudeText }),
    });
  };
}

/**
 * Points, lines, areas and solids of the geofence, of the obstacles, and of the area that a person is drawing.
 * @param home_amsl_m altitude of home.
 */
export function areaLayer(
  plan: DocumentAreas,
  selected: ReadonlySet<string>,
  sketch: Sketch | null,
  home_amsl_m: number,
): { points: LayerPoint[]; lines: LayerLine[]; areas: LayerArea[]; solids: LayerSolid[] } {
  const points: LayerPoint[] = [];
  const add = pointAdder(points, selected);
  const addPolygon = (polygon: readonly GeoPosition[], cornerPrefix: string, midpointPrefix: string, tone: Tone): void => {
    polygon.forEach((corner, i) => add(`${cornerPrefix}:${i}`, corner, 'corner', tone));
    polygon.forEach((corner, i) => add(`${midpointPrefix}:${i + 1}`, midpoint(corner, polygon[(i + 1) % polygon.length] ?? corner), 'midpoint', tone));
  };
  plan.fence.forEach((zone, index) => {
    const tone = toneOf(zone);
    if (zone.shape === 'circle') add(`circle:${index}`, zone.center, 'corner', tone);
    else addPolygon(zone.polygon, `corner:${index}`, `side:${index}`, tone);
  });
  obstaclesOf(plan).forEach(({ polygon }, index) => addPolygon(polygon, `obstacle:${index}`, `edge:${index}`, 'danger'));
  sketch?.corners.forEach((corner, i) => add(`sketch:${i}`, corner, 'corner', sketch.tone));
  const fenceLines = plan.fence.map((zone): LayerLine => {
    const ring = ringOf(zone);
    return { positions: [...ring, ...ring.slice(0, 1)], tone: toneOf(zone), style: 'dashed' };
  });
  const obstacleLines = obstaclesOf(plan).map(({ polygon }): LayerLine => ({
    positions: [...polygon, ...polygon.slice(0, 1)],
    tone: 'danger',
    style: 'solid',
  }));
  const solids = obstaclesOf(plan).map(({ polygon, top }): LayerSolid => ({ ring: polygon, top_amsl_m: alt_amsl_m(top, home_amsl_m), tone: 'danger' }));
  return { points, lines: [...fenceLines, ...obstacleLines], areas: areasOf(plan, sketch), solids };
}

/** An inclusion zone has the colour of a limit, an exclusion zone the colour of a forbidden area. */
function toneOf(zone: FenceZone): Tone {
  return zone.inclusion ? 'caution' : 'danger';
}

/** The outline of a fence zone. */
export function ringOf(zone: FenceZone): GeoPosition[] {
  if (zone.shape === 'polygon') return [...zone.polygon];
  const { lat_deg, lon_deg } = zone.center;
  const north_deg = zone.radius_m / EARTH_M_PER_DEG;
  const east_deg = north_deg / Math.max(0.01, Math.cos((lat_deg * Math.PI) / 180));
  return Array.from({ length: CIRCLE_CORNERS }, (_, i) => {
    const angle = (i / CIRCLE_CORNERS) * 2 * Math.PI;
    return { lat_deg: lat_deg + north_deg * Math.cos(angle), lon_deg: lon_deg + east_deg * Math.sin(angle) };
  });
}

/** The areas and lines from which patterns are made. */
function outlines(plan: Plan): LayerLine[] {
  return plan.items.filter(isPatternItem).flatMap(({ pattern }) =>
    ringsOf(pattern)
      .filter((ring) => ring.length > 1)
      .map((ring): LayerLine => ({ positions: pattern.kind === 'corridor' ? ring : [...ring, ...ring.slice(0, 1)], tone: 'actual', style: 'dashed' })),
  );
}

function pathLines(
  plan: Plan,
  withAltitude: (item: GeoPosition & { readonly altitude: Altitude }) => LayerPosition,
  start: Required<LayerPosition>,
): LayerLine[] {
  const path = flownItems(plan).map(({ item }) => withAltitude(item));
  const home = plan.planned_home === null ? null : { ...plan.planned_home, alt_amsl_m: start.alt_amsl_m };
  const lines: LayerLine[] = [];
  if (path.length > 1) lines.push({ positions: path, tone: 'target', style: 'solid' });
  const [first, last] = [path[0], path.at(-1)];
  if (home !== null && first !== undefined) lines.push({ positions: [home, first], tone: 'target', style: 'dotted' });
  const hasReturn = plan.items.some((item) => item.kind === 'return_home');
  if (home !== null && last !== undefined && hasReturn) lines.push({ positions: [last, home], tone: 'target', style: 'dotted' });
  return lines;
}

export function sketchLines(sketch: Sketch | null): LayerLine[] {
  const corners = sketch?.corners ?? [];
  const [first, tone] = [corners[0], sketch?.tone];
  if (first === undefined || corners.length < 2 || tone === undefined) return [];
  return [{ positions: [...corners, first], tone, style: 'dashed' }];
}

function areasOf(plan: DocumentAreas, sketch: Sketch | null): LayerArea[] {
  const forbiddenAreas = [
    ...plan.fence.filter((zone) => !zone.inclusion).map((zone) => ({ ring: ringOf(zone), tone: 'danger' as const })),
    ...obstaclesOf(plan).map(({ polygon }) => ({ ring: polygon, tone: 'danger' as const })),
  ];
  return sketch !== null && sketch.corners.length > 2 ? [...forbiddenAreas, { ring: sketch.corners, tone: sketch.tone }] : forbiddenAreas;
}
