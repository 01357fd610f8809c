/**
 * Tracks which parts of the stage are covered by panels, so that map and 3D view show the vehicle in the middle of
 * the free area.
 */

import { coveredAtEdges, type Edge } from './free-area';

let panels = $state.raw<ReadonlyMap<HTMLElement, { edge: Edge; px: number }>>(new Map());

/** Width or height that panels cover at each edge [px]. */
export function covered(): Record<Edge, number> {
  return coveredAtEdges(panels.values());
}

/** Svelte action: counts the panel's width or height as covered at this edge of the stage. */
export function covers(panel: HTMLElement, edge: Edge): { destroy: () => void } {
  const setCovered = (px: number): void => {
    if (px === (panels.get(panel)?.px ?? 0)) return;
    const otherPanels = [...panels].filter(([other]) => other !== panel);
    panels = new Map(px > 0 ? [...otherPanels, [panel, { edge, px }]] : otherPanels);
  };
  const observer = new ResizeObserver(() => {
    const box = panel.getBoundingClientRect(); // includes the CSS zoom of the panels on large screens
    setCovered(Math.round(edge === 'bottom' || edge === 'top' ? box.height : box.width));
  });
  observer.observe(panel);
  return {
    destroy: () => {
      observer.disconnect();
      setCovered(0);
    },
  };
}
