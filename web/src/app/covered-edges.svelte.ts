/**
 * Tracks which parts of the stage are covered by panels, so that map and 3D view show the vehicle in the middle of
 * the free area.
 */

import type { Pixel } from '../vehicle/geo';

let panels = $state.raw<ReadonlyMap<HTMLElement, { edge: Edge; px: number }>>(new Map());

/** Width or height that panels cover at each edge [px]. */
export function covered(): Record<Edge, number> {
  return coveredAtEdges(panels.values());
}

/** Svelte action: counts the panel's width or height as covered at this edge of the stage. */
export function covers(panel: HTMLElement, initialEdge: Edge): { update: (edge: Edge) => void; destroy: () => void } {
  let edge = initialEdge;
  const setCovered = (px: number): void => {
    const before = panels.get(panel);
    if (px === (before?.px ?? 0) && (px === 0 || before?.edge === edge)) return;
    const otherPanels = [...panels].filter(([other]) => other !== panel);
    panels = new Map(px > 0 ? [...otherPanels, [panel, { edge, px }]] : otherPanels);
  };
  const measure = (): void => {
    const box = panel.getBoundingClientRect(); // includes the CSS zoom of the panels on large screens
    const margin_px = edge === 'bottom' ? parseFloat(getComputedStyle(panel).marginBottom) || 0 : 0; // on a phone the cards are above the action bar
    setCovered(Math.round(edge === 'bottom' || edge === 'top' ? box.height + margin_px : box.width));
  };
  const observer = new ResizeObserver(measure);
  observer.observe(panel);
  return {
    update: (newEdge) => {
      edge = newEdge;
      measure();
    },
    destroy: () => {
      observer.disconnect();
      setCovered(0);
    },
  };
}

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
