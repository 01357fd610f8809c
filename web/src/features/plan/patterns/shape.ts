/** The drawn shape from which a pattern is generated: an area with holes, a line, or a point. Pure functions. */

import type { GeneratedPattern } from '../api';
import { areaText, distance, durationText, fixed, lengthText } from '../../../ui/format';
import { positionAt, type GeoPosition } from '../../../vehicle/geo';
import type { Pattern } from '../document/document';
import { midpoint } from '../document/edit';
import { PATTERN_TITLES } from '../document/items';

export type PatternKind = Pattern['kind'];
export type ShapeKind = 'area' | 'line' | 'point';

export interface PatternType {
  readonly title: string;
  /** Name of the pattern in a sentence. */
  readonly noun: string;
  readonly shape: ShapeKind;
  /** What the pattern is for. */
  readonly hint: string;
  /** Label of the distance between the lines or rounds. */
  readonly spacingLabel: string;
}

export const PATTERNS: Readonly<Record<PatternKind, PatternType>> = {
  survey: {
    title: PATTERN_TITLES.survey,
    noun: 'survey',
    shape: 'area',
    hint: 'Parallel lines over an area, with overlapping photos.',
    spacingLabel: 'Line spacing',
  },
  corridor: {
    title: PATTERN_TITLES.corridor,
    noun: 'corridor',
    shape: 'line',
    hint: 'Parallel lines along a road, a river or a power line, with photos.',
    spacingLabel: 'Line spacing',
  },
  perimeter: { title: PATTERN_TITLES.perimeter, noun: 'perimeter', shape: 'area', hint: 'Rounds along the edge of an area.', spacingLabel: 'Line spacing' },
  orbit: { title: PATTERN_TITLES.orbit, noun: 'orbit', shape: 'point', hint: 'Circles around a point.', spacingLabel: 'Line spacing' },
  structure: {
    title: PATTERN_TITLES.structure,
    noun: 'structure scan',
    shape: 'area',
    hint: 'Rounds around a structure at several heights, with photos of its sides.',
    spacingLabel: 'Height between rounds',
  },
};
export const PATTERN_KINDS = Object.keys(PATTERNS) as PatternKind[];

/** The outline, the line or the point first, then the holes of an area. */
export type Rings = readonly (readonly GeoPosition[])[];
export const NO_RINGS: Rings = [[]];

/** One point of the shape. */
export interface ShapePoint {
  readonly ring: number;
  readonly index: number;
}

const MIN_POINTS: Readonly<Record<ShapeKind, number>> = { area: 3, line: 2, point: 1 };

/** Number of points that the shape still needs; a hole without points needs none. */
export function missingPoints(rings: Rings, kind: ShapeKind): number {
  return Math.max(0, ...rings.map((ring, i) => (i > 0 && ring.length === 0 ? 0 : MIN_POINTS[kind] - ring.length)));
}

const latLon = ({ lat_deg, lon_deg }: GeoPosition): GeoPosition => ({ lat_deg, lon_deg });
const withRing = (rings: Rings, ring: number, points: readonly GeoPosition[]): Rings => rings.map((old, i) => (i === ring ? points : old));

/** Adds a point at the end of a ring, or moves the only point of an orbit. */
export function addPoint(rings: Rings, kind: ShapeKind, ring: number, position: GeoPosition): Rings {
  return withRing(rings, ring, kind === 'point' ? [latLon(position)] : [...(rings[ring] ?? []), latLon(position)]);
}

export function insertPoint(rings: Rings, { ring, index }: ShapePoint, position: GeoPosition): Rings {
  const points = rings[ring] ?? [];
  return withRing(rings, ring, [...points.slice(0, index), latLon(position), ...points.slice(index)]);
}

export function movePoint(rings: Rings, { ring, index }: ShapePoint, to: GeoPosition): Rings {
  return withRing(
    rings,
    ring,
    (rings[ring] ?? []).map((point, i) => (i === index ? latLon(to) : point)),
  );
}

/** Removes a point; a hole without points is removed. */
export function removePoint(rings: Rings, { ring, index }: ShapePoint): Rings {
  const remainingRings = withRing(
    rings,
    ring,
    (rings[ring] ?? []).filter((_, i) => i !== index),
  );
  return remainingRings.filter((points, i) => i === 0 || points.length > 0 || i !== ring);
}

/** Begins an empty hole, unless the last hole is still empty. */
export function addHole(rings: Rings): Rings {
  return rings.at(-1)?.length === 0 ? rings : [...rings, []];
}

/** A rectangle with this centre, clockwise from its north-west corner. */
export function rectangle(center: GeoPosition, half_east_m: number, half_north_m: number): GeoPosition[] {
  const corners = [
    [-1, 1],
    [1, 1],
    [1, -1],
    [-1, -1],
  ] as const;
  return corners.map(([east, north]) => positionAt(center, { east_m: east * half_east_m, north_m: north * half_north_m }));
}

/** The part of a shape that a kind of pattern can use: only a survey has holes, and an orbit has only one point. */
export function usableRings(rings: Rings, kind: PatternKind): Rings {
  const { shape } = PATTERNS[kind];
  const [firstRing = [], ...holes] = rings;
  if (shape === 'point') return [firstRing.slice(0, 1)];
  return kind === 'survey' ? [firstRing, ...holes] : [firstRing];
}

/** The points of a shape as the choices of a select: `RING:INDEX` and the displayed name. */
export function pointChoices(rings: Rings, kind: ShapeKind): { value: string; text: string }[] {
  const pointLabel = kind === 'line' ? 'Point' : kind === 'point' ? 'Centre' : 'Corner';
  return rings.flatMap((points, ring) =>
    points.map((_, index) => ({
      value: `${ring}:${index}`,
      text: kind === 'point' ? pointLabel : `${ring > 0 ? `Hole ${ring}, corner` : pointLabel} ${index + 1}`,
    })),
  );
}

export const pointId = ({ ring, index }: ShapePoint): string => `shape:${ring}:${index}`;

/** Parses the id of a point on the map. For a midpoint, `point` is the point that would be inserted there. */
export function pointOfId(id: string): { point: ShapePoint; isMidpoint: boolean } | null {
  const match = /^(shape|between):(\d+):(\d+)$/.exec(id);
  return match === null ? null : { point: { ring: Number(match[2]), index: Number(match[3]) }, isMidpoint: match[1] === 'between' };
}

/** The midpoints of the sides, at which a point can be inserted. */
export function midpoints(rings: Rings, kind: ShapeKind): { id: string; position: GeoPosition }[] {
  if (kind === 'point') return [];
  return rings.flatMap((points, ring) => {
    const isClosed = kind === 'area' && points.length > 2;
    return points.flatMap((a, index) => {
      const b = points[index + 1] ?? (isClosed ? points[0] : undefined);
      return b === undefined ? [] : [{ id: `between:${ring}:${index + 1}`, position: midpoint(a, b) }];
    });
  });
}

export interface Figure {
  readonly label: string;
  readonly value: string;
}

/**
 * The figures of a pattern, without those that do not apply, such as the resolution of a pattern without photos.
 * @param spacingLabel name of the distance between lines or rounds.
 */
export function figuresOf(figures: GeneratedPattern['figures'], spacingLabel: string): Figure[] {
  const length = distance(figures.length_m);
  const allFigures: (Figure | null)[] = [
    { label: 'Length', value: `${length.text} ${length.unit}` },
    { label: 'Time', value: durationText(figures.time_s) },
    figures.photos > 0 ? { label: 'Photos', value: fixed(figures.photos, 0) } : null,
    figures.resolution_m_px === null ? null : { label: 'Resolution', value: `${fixed(figures.resolution_m_px * 100, 2)} cm/px` },
    figures.area_m2 === null ? null : { label: 'Area', value: areaText(figures.area_m2) },
    figures.trigger_m > 0 ? { label: 'Photo every', value: lengthText(figures.trigger_m) } : null,
    figures.spacing_m > 0 ? { label: spacingLabel, value: lengthText(figures.spacing_m) } : null,
    figures.heading_deg === null ? null : { label: 'Line heading', value: `${fixed(figures.heading_deg, 0)}°` },
  ];
  return allFigures.filter((figure) => figure !== null);
}
