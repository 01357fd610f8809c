/** The shape that is being drawn, and the lines of its pattern, as a map layer. Pure. */

import type { LayerLine, LayerPicture, LayerPoint } from '../../../app/map-layers.svelte';
import { ringOf } from '../document/layer';
import type { MadePattern } from '../api';
import { midpoints, pointId, type Rings, type ShapeKind, type ShapePoint } from './shape';

/** Above this number of points, midpoints would cover the corners. */
const MAX_MIDPOINTS = 60;

/** @param radius_m of an orbit, whose circle is drawn until the server has generated it; null: of no orbit. */
export function shapePicture(
  rings: Rings,
  kind: ShapeKind,
  selected: ShapePoint | null,
  made: MadePattern | null,
  isCurrent: boolean,
  radius_m: number | null,
): LayerPicture {
  const points: LayerPoint[] = [];
  if (rings.flat().length <= MAX_MIDPOINTS)
    for (const { id, at } of midpoints(rings, kind)) points.push({ id, ...at, mark: 'middle', tone: 'actual', text: '', selected: false });
  rings.forEach((ring, i) =>
    ring.forEach((at, index) => {
      const isSelected = selected?.ring === i && selected.index === index;
      points.push({ id: pointId({ ring: i, index }), ...at, mark: kind === 'point' ? 'cross' : 'corner', tone: 'actual', text: '', selected: isSelected });
    }),
  );
  return { points, lines: [...outlines(rings, kind, radius_m), ...patternLines(made, isCurrent)], areas: areas(rings, kind) };
}

function outlines(rings: Rings, kind: ShapeKind, radius_m: number | null): LayerLine[] {
  const [center] = rings[0] ?? [];
  if (kind === 'point' && center !== undefined && radius_m !== null) {
    const ring = ringOf({ shape: 'circle', inclusion: true, center, radius_m });
    return [{ positions: [...ring, ...ring.slice(0, 1)], tone: 'actual', style: 'dashed' }];
  }
  return rings
    .filter((ring) => ring.length > 1)
    .map((ring) => ({ positions: kind === 'area' ? [...ring, ...ring.slice(0, 1)] : ring, tone: 'actual', style: 'dashed' }));
}

/** The path, with the lines on which pictures are taken; dotted while it belongs to an earlier shape or setting. */
function patternLines(made: MadePattern | null, isCurrent: boolean): LayerLine[] {
  if (made === null) return [];
  const pictured = made.lines.map((positions): LayerLine => ({ positions, tone: 'target', style: isCurrent ? 'solid' : 'dotted' }));
  const style = isCurrent && pictured.length === 0 ? 'solid' : 'dotted';
  return [...(made.path.length > 1 ? [{ positions: made.path, tone: 'target', style } as const] : []), ...pictured];
}

function areas(rings: Rings, kind: ShapeKind): LayerPicture['areas'] {
  if (kind !== 'area') return [];
  return rings.filter((ring) => ring.length > 2).map((ring, i) => ({ ring, tone: i === 0 ? ('actual' as const) : ('text2' as const) }));
}
