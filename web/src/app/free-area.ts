/** The area of the stage that no panel covers; map and 3D view show the followed vehicle in its middle. */

import type { Pixel } from '../vehicle/geo';

export type Edge = 'left' | 'right' | 'top' | 'bottom';

/** Margin between panels and the stage's edge [px]. */
const MARGIN_PX = 12;

/** Of several panels at one edge, the widest counts. */
export function widest(panels: Iterable<{ edge: Edge; px: number }>): Record<Edge, number> {
  const covered = { left: 0, right: 0, top: 0, bottom: 0 };
  for (const { edge, px } of panels) covered[edge] = Math.max(covered[edge], px);
  return covered;
}

/** Offset of the free area's middle from the stage's, right and down [px]; zero if panels cover the whole stage. */
export function freeMiddle(stage: { width: number; height: number }, covered: Readonly<Record<Edge, number>>): Pixel {
  const { width, height } = stage;
  const from = (px: number): number => (px === 0 ? 0 : px + MARGIN_PX);
  const [left, right, top, bottom] = [from(covered.left), covered.right, from(covered.top), from(covered.bottom)];
  return {
    x: left + right < width ? Math.round((left - right) / 2) : 0,
    y: top + bottom < height ? Math.round((top - bottom) / 2) : 0,
  };
}

/** The same offset as a fraction of the stage's size, for the 3D view. */
export function asShares(middle: Pixel, stage: { width: number; height: number }): [number, number] {
  const share = (px: number, of: number): number => (of > 0 ? Number(Math.max(-0.4, Math.min(px / of, 0.4)).toFixed(4)) : 0);
  return [share(middle.x, stage.width), share(middle.y, stage.height)];
}
