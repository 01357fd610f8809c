/** The area of the stage that no panel covers; map and 3D view show the followed vehicle in the middle of this area. */

import type { Pixel } from '../vehicle/geo';

export type Edge = 'left' | 'right' | 'top' | 'bottom';

/** Margin between panels and the stage's edge [px]; on the right, the measured width of the cards already contains a margin. */
const MARGIN_PX = 12;

/** The width or height that panels cover at each edge [px]; of several panels at one edge, the largest value. */
export function coveredAtEdges(panels: Iterable<{ edge: Edge; px: number }>): Record<Edge, number> {
  const covered = { left: 0, right: 0, top: 0, bottom: 0 };
  for (const { edge, px } of panels) covered[edge] = Math.max(covered[edge], px);
  return covered;
}

/** Offset of the free area's middle from the stage's middle, right and down [px]; zero if panels cover the whole stage. */
export function freeAreaOffset(stage: { width: number; height: number }, covered: Readonly<Record<Edge, number>>): Pixel {
  const { width, height } = stage;
  const withMargin = (px: number): number => (px === 0 ? 0 : px + MARGIN_PX);
  const [left, right, top, bottom] = [withMargin(covered.left), covered.right, withMargin(covered.top), withMargin(covered.bottom)];
  return {
    x: left + right < width ? Math.round((left - right) / 2) : 0,
    y: top + bottom < height ? Math.round((top - bottom) / 2) : 0,
  };
}

/** The offset as fractions of the stage's width and height, each limited to ±0.4, for the 3D view. */
export function offsetFractions(offset: Pixel, stage: { width: number; height: number }): [number, number] {
  const fraction = (px: number, size: number): number => (size > 0 ? Number(Math.max(-0.4, Math.min(px / size, 0.4)).toFixed(4)) : 0);
  return [fraction(offset.x, stage.width), fraction(offset.y, stage.height)];
}
