/** An open log: its overview, the panes of plots, and the window of time that all panes show. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import { plotsShown } from './plots-shown.svelte';
import { fieldsOfSet, type PlotSet } from './sets';

type Schemas = components['schemas'];
export type Overview = Schemas['FlightOverview'];
export type Series = Schemas['LogSeries'];
export interface Pane {
  readonly id: number;
  readonly fields: readonly string[];
}
export interface Window {
  readonly from_s: number;
  readonly to_s: number;
}

/** Points of a series: two for each pixel of a wide plot. */
const POINTS = 3000;
/** Values are requested again after this pause in zooming [ms]. */
const PAUSE_MS = 60;
export const MAX_PANES = 8;
export const MAX_FIELDS = 8;
const MIN_WINDOW_S = 0.05;

export class LogView {
  /** Id of the open flight; null: the list is shown. */
  id = $state<string | null>(null);
  name = $state('');
  overview = $state.raw<Overview | null>(null);
  problem = $state.raw<Pick<Problem, 'title' | 'detail'> | null>(null);
  panes = $state.raw<readonly Pane[]>([]);
  /** Id of the pane to which chosen fields are added. */
  activePane = $state(0);
  series = $state.raw<ReadonlyMap<string, Series>>(new Map());
  /** The shown window. */
  shown = $state.raw<Window>({ from_s: 0, to_s: 1 });
  /** Time at the cursor of all panes; null: none. */
  cursor_s = $state<number | null>(null);
  private nextPane = 1;
  private timer: ReturnType<typeof setTimeout> | null = null;
  private request = 0;
  /** The window and fields of the values in `series`. */
  private loadedKey = '';

  constructor(private readonly api: ApiClient) {}

  /** The window of the whole log. */
  readonly whole = $derived<Window>(wholeOf(this.overview));

  async open(id: string, name: string): Promise<void> {
    this.close();
    this.id = id;
    this.name = name;
    const response = await this.api.get('/flights/{f}', { params: { path: { f: id } } });
    if (this.id !== id) return;
    if (!response.ok) {
      this.problem = response.problem;
      return;
    }
    this.overview = response.value;
    plotsShown.isOpen = true;
    this.shown = this.whole;
    this.addPane();
  }

  close(): void {
    if (this.timer !== null) clearTimeout(this.timer);
    this.id = this.overview = this.problem = this.cursor_s = null;
    plotsShown.isOpen = false;
    this.panes = [];
    this.series = new Map();
    this.loadedKey = '';
    this.request += 1;
  }

  addPane(fields: readonly string[] = []): void {
    if (this.panes.length >= MAX_PANES) return;
    this.activePane = this.nextPane++;
    this.panes = [...this.panes, { id: this.activePane, fields }];
    this.requestSeries();
  }

  removePane(id: number): void {
    this.panes = this.panes.filter((pane) => pane.id !== id);
    if (this.panes.length === 0) this.addPane();
    if (!this.panes.some((pane) => pane.id === this.activePane)) this.activePane = this.panes.at(-1)?.id ?? 0;
  }

  /** Adds a field or expression to a pane, or removes it if the pane has it. */
  toggle(field: string, paneId = this.activePane): void {
    this.panes = this.panes.map((pane) => {
      if (pane.id !== paneId) return pane;
      if (pane.fields.includes(field)) return { ...pane, fields: pane.fields.filter((each) => each !== field) };
      return pane.fields.length >= MAX_FIELDS ? pane : { ...pane, fields: [...pane.fields, field] };
    });
    this.requestSeries();
  }

  isPlotted(field: string): boolean {
    return this.panes.some((pane) => pane.id === this.activePane && pane.fields.includes(field));
  }

  /** Shows the panes of a set in place of the present ones. */
  showSet(set: PlotSet): void {
    if (this.overview === null) return;
    const panes = fieldsOfSet(set, this.overview.topics);
    if (panes.length === 0) return;
    this.panes = panes.slice(0, MAX_PANES).map((fields) => ({ id: this.nextPane++, fields }));
    this.activePane = this.panes[0]?.id ?? 0;
    this.requestSeries();
  }

  /** Shows what proves a statement: these panes in place of the present ones, and the time with as much before and after it. */
  showEvidence(panes: readonly (readonly string[])[], { from_s, to_s }: Window): void {
    const filled = panes.filter((fields) => fields.length > 0);
    if (filled.length > 0) {
      this.panes = filled.slice(0, MAX_PANES).map((fields) => ({ id: this.nextPane++, fields: fields.slice(0, MAX_FIELDS) }));
      this.activePane = this.panes[0]?.id ?? 0;
    }
    const margin_s = Math.max(2, to_s - from_s);
    this.zoom({ from_s: from_s - margin_s, to_s: to_s + margin_s });
    this.cursor_s = Math.max(this.whole.from_s, from_s);
  }

  /** Shows a window, within the log. */
  zoom({ from_s, to_s }: Window): void {
    const { whole } = this;
    const length_s = Math.min(whole.to_s - whole.from_s, Math.max(MIN_WINDOW_S, to_s - from_s));
    const begin_s = Math.min(Math.max(whole.from_s, from_s), whole.to_s - length_s);
    this.shown = { from_s: begin_s, to_s: begin_s + length_s };
    this.requestSeries();
  }

  /** Zooms by a factor around the cursor, or else the middle. */
  zoomBy(factor: number): void {
    const { from_s, to_s } = this.shown;
    const isInside = this.cursor_s !== null && this.cursor_s > from_s && this.cursor_s < to_s;
    const at_s = isInside && this.cursor_s !== null ? this.cursor_s : (from_s + to_s) / 2;
    this.zoom({ from_s: at_s - (at_s - from_s) * factor, to_s: at_s + (to_s - at_s) * factor });
  }

  /** Moves the window by a part of its length. */
  pan(part: number): void {
    const length_s = this.shown.to_s - this.shown.from_s;
    this.zoom({ from_s: this.shown.from_s + part * length_s, to_s: this.shown.to_s + part * length_s });
  }

  /** Puts the cursor on a time, and shows it. */
  moveCursor(t_s: number): void {
    const { from_s, to_s } = this.shown;
    if (t_s < from_s || t_s > to_s) this.zoom({ from_s: t_s - (to_s - from_s) / 2, to_s: t_s + (to_s - from_s) / 2 });
    this.cursor_s = t_s;
  }

  private requestSeries(): void {
    if (this.timer !== null) clearTimeout(this.timer);
    this.timer = setTimeout(() => void this.loadSeries(), PAUSE_MS);
  }

  /** Requests the values of all fields in the shown window, unless the page has them. */
  async loadSeries(): Promise<void> {
    const { id, shown } = this;
    const fields = [...new Set(this.panes.flatMap((pane) => pane.fields))].slice(0, 32);
    const key = JSON.stringify([id, shown, fields]);
    if (id === null || fields.length === 0 || key === this.loadedKey) return;
    const request = ++this.request;
    const response = await this.api.get('/flights/{f}/series', { params: { path: { f: id }, query: { field: fields, ...shown, points: POINTS } } });
    if (request !== this.request) return;
    this.problem = response.ok ? null : response.problem;
    if (!response.ok) return;
    this.loadedKey = key;
    this.series = new Map(response.value.series.map((each) => [each.field, each]));
  }
}

function wholeOf(overview: Overview | null): Window {
  const to_s = Math.max(0.1, overview?.duration_s ?? 1);
  return { from_s: 0, to_s };
}

/** The newest value of a series at a time; null: there is none. */
export function valueAt(series: Series | undefined, t_s: number | null): number | null {
  if (series === undefined || t_s === null) return null;
  let [low, high] = [0, series.t_s.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((series.t_s[middle] ?? Infinity) <= t_s) low = middle + 1;
    else high = middle;
  }
  return series.values[low - 1] ?? null;
}

/** A time since the log's start, and the time of day if it is known. */
export function timeText(t_s: number, start_unix_s: number | null): string {
  const since = `${t_s.toFixed(t_s < 100 ? 2 : 1)} s`;
  if (start_unix_s === null) return since;
  const date = new Date((start_unix_s + t_s) * 1000);
  return `${since} · ${[date.getHours(), date.getMinutes(), date.getSeconds()].map((n) => String(n).padStart(2, '0')).join(':')}`;
}
