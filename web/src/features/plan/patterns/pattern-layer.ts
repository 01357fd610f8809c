/** Map layer with the drawn shape on the ground and the generated pattern's lines at their altitudes. Pure functions. */

import type { LayerLine, LayerContent, LayerPoint, LayerPosition } from '../../../app/map-layers.svelte';
import { groundDistance_m } from '../../../vehicle/geo';
import { alt_amsl_m } from '../document/document';
import { ringOf } from '../document/layer';
import type { GeneratedPattern } from '../api';
import { midpoints, pointId, type Rings, type ShapeKind, type ShapePoint } from './shape';

/** Above this number of points, midpoints would cover the corners. */
const MAX_MIDPOINTS = 60;

/** Positions closer to each other than this distance [m] are the same. The distance exceeds the rounding in JSON. */
const SAME_POSITION_M = 0.01;

/**
 * Points, lines and areas of a drawn shape and of its generated pattern.
 * @param radius_m radius of the circle of an orbit; null: another pattern.
 * @param start position of home; altitudes above home are relative to its altitude.
 */
export function patternLayer(
  rings: Rings,
  kind: ShapeKind,
  selected: ShapePoint | null,
  generated: GeneratedPattern | null,
  isCurrent: boolean,
  radius_m: number | null,
  start: Required<LayerPosition>,
): LayerContent {
  const points: LayerPoint[] = [];
  if (rings.flat().length <= MAX_MIDPOINTS)
    for (const { id, position } of midpoints(rings, kind)) points.push({ id, ...position, mark: 'midpoint', tone: 'actual', text: '', selected: false });
  rings.forEach((ring, i) =>
    ring.forEach((position, index) => {
      const isSelected = selected?.ring === i && selected.index === index;
      points.push({
        id: pointId({ ring: i, index }),
        ...position,
        mark: kind === 'point' ? 'cross' : 'corner',
        tone: 'actual',
        text: '',
        selected: isSelected,
      });
    }),
  );
  return {
    points,
    lines: [...shapeLines(rings, kind, radius_m), ...patternLines(generated, isCurrent, start.alt_amsl_m)],
    areas: areasOf(rings, kind),
    ground: start,
  };
}

function shapeLines(rings: Rings, kind: ShapeKind, radius_m: number | null): LayerLine[] {
  const [center] = rings[0] ?? [];
  if (kind === 'point' && center !== undefined && radius_m !== null) {
    const ring = ringOf({ shape: 'circle', inclusion: true, center, radius_m });
    return [{ positions: [...ring, ...ring.slice(0, 1)], tone: 'actual', style: 'dashed' }];
  }
  return rings
    .filter((ring) => ring.length > 1)
    .map((ring) => ({ positions: kind === 'area' ? [...ring, ...ring.slice(0, 1)] : ring, tone: 'actual', style: 'dashed' }));
}

/** The path, and the lines on which photos are taken; dotted while they belong to an earlier shape or setting. */
function patternLines(generated: GeneratedPattern | null, isCurrent: boolean, home_amsl_m: number): LayerLine[] {
  if (generated === null) return [];
  const path = generated.path.map(({ lat_deg, lon_deg, altitude }) => ({ lat_deg, lon_deg, alt_amsl_m: alt_amsl_m(altitude, home_amsl_m) }));
  const photoLines = linesOnPath(path, generated.lines).map((positions): LayerLine => ({ positions, tone: 'target', style: isCurrent ? 'solid' : 'dotted' }));
  const style = isCurrent && photoLines.length === 0 ? 'solid' : 'dotted';
  return [...(path.length > 1 ? [{ positions: path, tone: 'target', style } as const] : []), ...photoLines];
}

/**
 * The lines with the altitudes of the path. The path contains the lines in the same order; each line begins at a
 * position of the path. A path that follows the ground can have more positions along a line.
 */
export function linesOnPath(path: readonly Required<LayerPosition>[], lines: GeneratedPattern['lines']): LayerPosition[][] {
  let searchStart = 0;
  return lines.map(([start, end]) => {
    const startIndex = path.findIndex((position, i) => i >= searchStart && groundDistance_m(position, start) < SAME_POSITION_M);
    if (startIndex < 0) return [start, end];
    const length_m = groundDistance_m(start, end);
    const distance_m = (i: number): number => groundDistance_m(start, path[i] ?? end);
    let endIndex = startIndex + 1;
    while (endIndex < path.length && distance_m(endIndex) < length_m - SAME_POSITION_M) endIndex += 1;
    searchStart = endIndex - 1;
    const [previous, next] = [path[endIndex - 1], path[endIndex] ?? path[endIndex - 1]];
    const span_m = distance_m(endIndex) - distance_m(endIndex - 1);
    const fraction = span_m > SAME_POSITION_M ? (length_m - distance_m(endIndex - 1)) / span_m : 0;
    const [previous_amsl_m, next_amsl_m] = [previous?.alt_amsl_m ?? 0, next?.alt_amsl_m ?? 0];
    return [
      ...path.slice(startIndex, endIndex),
      { lat_deg: end.lat_deg, lon_deg: end.lon_deg, alt_amsl_m: previous_amsl_m + fraction * (next_amsl_m - previous_amsl_m) },
    ];
  });
}

function areasOf(rings: Rings, kind: ShapeKind): LayerContent['areas'] {
  if (kind !== 'area') return [];
  return rings.filter((ring) => ring.length > 2).map((ring, i) => ({ ring, tone: i === 0 ? ('actual' as const) : ('text2' as const) }));
}
