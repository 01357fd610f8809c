/** Panes of plots that a person has saved by name, in the settings. */

import type { components } from '../api/schema';
import { userSettings } from '../app/settings.svelte';
import type { PaneContent, PlotView } from './plot-view.svelte';
import { labelOf, placed, RERUN } from './sets';

export type Layout = components['schemas']['PlotLayout'];
export const MAX_LAYOUTS = 40;

export function layouts(): readonly Layout[] {
  return userSettings.get('plot_layouts') ?? [];
}

/** The shown panes as a layout, without what is not of a log. */
export function layoutOf(name: string, view: PlotView): Layout {
  const isKept = (field: string): boolean => !field.startsWith(RERUN);
  const panes = view.panes
    .map(({ fields, right, isSpectrum }) => ({
      fields: fields.filter(isKept),
      right_axis: right?.filter(isKept) ?? null,
      spectrum: isSpectrum === true,
    }))
    .filter(({ fields }) => fields.length > 0);
  return { name: name.trim(), panes, window_s: view.savedLength_s };
}

/** The layouts with one more; it replaces one of the same name. */
export function withLayout(all: readonly Layout[], added: Layout): readonly Layout[] {
  const isNew = all.every(({ name }) => name !== added.name);
  return isNew ? [...all, added] : all.map((each) => (each.name === added.name ? added : each));
}

/** The layouts with another name for one; unchanged if the name is empty or that of another. */
export function renamed(all: readonly Layout[], from: string, to: string): readonly Layout[] {
  const name = to.trim();
  if (name === '' || all.some((each) => each.name === name)) return all;
  return all.map((each) => (each.name === from ? { ...each, name } : each));
}

/** Shows a layout in place of the present panes. @returns labels of its fields that are not here; none of them is here: nothing changes. */
export function showLayout({ panes, window_s }: Layout, view: PlotView): readonly string[] {
  const missing: string[] = [];
  const found = panes.map(({ fields, right_axis, spectrum }): PaneContent => {
    for (const saved of fields) if (placed(saved, view.sources) === null) missing.push(labelOf(saved));
    const here = (all: readonly string[]): string[] => all.flatMap((saved) => placed(saved, view.sources) ?? []);
    return { fields: here(fields), ...(right_axis == null ? {} : { right: here(right_axis) }), isSpectrum: spectrum };
  });
  const shown = found.filter(({ fields }) => fields.length > 0);
  if (shown.length > 0) {
    view.showPanes(shown);
    view.showLength(window_s ?? null);
  }
  return missing;
}

export function save(all: readonly Layout[]): void {
  userSettings.set('plot_layouts', all.length === 0 ? null : all);
}
