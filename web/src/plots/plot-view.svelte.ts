/** Panes of plots over one window of time with one cursor. Where their values come from is the subclass's: a log, or a vehicle that flies. */

import type { Outcome } from '../api/client';
import type { Problem } from '../api/problems';
import type { components } from '../api/schema';
import { fieldsOfSet, type PlotSet } from './sets';
import type { Spectrum } from './spectrum';

type Schemas = components['schemas'];
export type Series = Schemas['LogSeries'];
/** States of a vehicle over time. */
export type States = Omit<Schemas['LogVehicle'], 'uid'>;
/** Topics whose fields can be plotted. */
export interface FieldSource {
  /** Whose they are, if there are several. */
  readonly source: Schemas['FlightPart']['source'] | null;
  /** What is put before a field or expression of this source; empty for the first. */
  readonly prefix: string;
  readonly topics: readonly Schemas['LogTopic'][];
}
/** What a pane shows. */
export interface PaneContent {
  readonly fields: readonly string[];
  /** Fields with the axis at the right; without: those whose unit is not that of the first. */
  readonly right?: readonly string[];
  /** Shown by frequency, not by time. */
  readonly isSpectrum?: boolean;
}
export interface Pane extends PaneContent {
  readonly id: number;
}
export interface Window {
  readonly from_s: number;
  readonly to_s: number;
}

export const MAX_PANES = 8;
export const MAX_FIELDS = 8;
/** Fields and expressions of all panes together, as the server takes them in one request. */
export const MAX_SERIES = 32;
/** Points of a series: two for each pixel of a wide plot. */
export const POINTS = 3000;
export const MIN_WINDOW_S = 0.05;

export abstract class PlotView {
  problem = $state.raw<Problem | null>(null);
  panes = $state.raw<readonly Pane[]>([]);
  /** Id of the pane to which chosen fields are added. */
  activePane = $state(0);
  series = $state.raw<ReadonlyMap<string, Series>>(new Map());
  /** The shown window. */
  shown = $state.raw<Window>({ from_s: 0, to_s: 1 });
  /** Time at the cursor of all panes; null: none. */
  cursor_s = $state<number | null>(null);
  private nextPane = 1;

  /** All that can be shown. */
  abstract readonly whole: Window;
  abstract readonly vehicles: readonly States[];
  abstract readonly sources: readonly FieldSource[];
  /** Time of day at 0 s [s since 1970 UTC]; null: not known. */
  abstract readonly start_unix_s: number | null;
  /** Panes, fields or window have changed. */
  protected abstract requestSeries(): void;

  /** Time whose values are shown while there is no cursor; null: none are. */
  get newest_s(): number | null {
    return null;
  }

  /** The series of a second flight that is drawn beside a field; null: none. */
  beside(_field: string): string | null {
    return null;
  }

  /** Fields that cannot be plotted, and why. */
  get failures(): ReadonlyMap<string, string> | undefined {
    return undefined;
  }

  /** Whether nothing more can be shown by a wider window. */
  get isWhole(): boolean {
    const { whole, shown } = this;
    return shown.to_s - shown.from_s >= whole.to_s - whole.from_s - 1e-6;
  }

  /** The fields of all panes, each once. */
  protected get plotted(): string[] {
    return [...new Set(this.panes.flatMap((pane) => pane.fields))];
  }

  /** Whether spectra can be shown. */
  get hasSpectra(): boolean {
    return false;
  }

  /** The spectrum of a field in a window; null: nothing of it is here any more. */
  loadSpectrum(_field: string, _window: Window): Promise<Outcome<Spectrum> | null> {
    return Promise.resolve(null);
  }

  /** Shows a pane by frequency, or by time again. */
  toggleSpectrum(id: number): void {
    this.panes = this.panes.map((pane) => (pane.id === id ? { ...pane, isSpectrum: pane.isSpectrum !== true } : pane));
  }

  /** The fields of a pane whose axis is at the right. */
  rightOf({ fields, right }: PaneContent): readonly string[] {
    if (right !== undefined) return right.filter((field) => fields.includes(field));
    const unit = (field: string): string | null => this.series.get(field)?.unit ?? null;
    const first = fields.map(unit).find((each) => each !== null) ?? null;
    return fields.filter((field) => unit(field) !== null && unit(field) !== first);
  }

  /** Gives a field of a pane the other axis. */
  changeAxis(id: number, field: string): void {
    this.panes = this.panes.map((pane) => {
      if (pane.id !== id) return pane;
      const right = this.rightOf(pane);
      return { ...pane, right: right.includes(field) ? right.filter((each) => each !== field) : [...right, field] };
    });
  }

  /** Shows these panes in place of the present ones. */
  showPanes(panes: readonly PaneContent[]): void {
    this.panes = panes.slice(0, MAX_PANES).map(({ fields, right, isSpectrum }) => ({
      id: this.nextPane++,
      fields: fields.slice(0, MAX_FIELDS),
      ...(right === undefined ? {} : { right }),
      ...(this.hasSpectra && isSpectrum === true ? { isSpectrum } : {}),
    }));
    this.activePane = this.panes[0]?.id ?? 0;
    this.requestSeries();
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
    const panes = this.fieldsOf(set);
    const spectra = panes.length > 1 ? (set.spectra ?? 0) : 0;
    if (panes.length > 0) this.showPanes(panes.map((fields, i) => ({ fields, isSpectrum: i >= panes.length - spectra })));
  }

  /** The fields of a set's panes, of the first source that has some. */
  fieldsOf(set: PlotSet): string[][] {
    for (const { prefix, topics } of this.sources) {
      const panes = fieldsOfSet(set, topics);
      if (panes.length > 0) return panes.map((fields) => fields.map((field) => prefix + field));
    }
    return [];
  }

  /** Shows a window, within the whole. */
  zoom({ from_s, to_s }: Window): void {
    const { whole } = this;
    const length_s = Math.min(whole.to_s - whole.from_s, Math.max(MIN_WINDOW_S, to_s - from_s));
    const begin_s = Math.min(Math.max(whole.from_s, from_s), whole.to_s - length_s);
    this.shown = { from_s: begin_s, to_s: begin_s + length_s };
    this.requestSeries();
  }

  /** Length of the window that a saved layout has; null: the whole. */
  get savedLength_s(): number | null {
    return this.isWhole ? null : this.shown.to_s - this.shown.from_s;
  }

  /** Shows a window of this length from the present begin on; null: the whole. */
  showLength(length_s: number | null): void {
    const { from_s } = this.shown;
    this.zoom(length_s === null ? this.whole : { from_s, to_s: from_s + length_s });
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
}

/** The newest value of a series at a time; null: there is none. */
export function valueAt(series: Series | undefined, t_s: number | null): number | null {
  return series === undefined || t_s === null ? null : (series.values[indexAfter(series.t_s, t_s) - 1] ?? null);
}

/** Index of the first of ascending times that is after a time. */
export function indexAfter(times: readonly number[], t_s: number): number {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((times[middle] ?? Infinity) <= t_s) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** A time since the start, and the time of day if it is known. */
export function timeText(t_s: number, start_unix_s: number | null): string {
  const since = `${t_s.toFixed(t_s < 100 ? 2 : 1)} s`;
  if (start_unix_s === null) return since;
  const date = new Date((start_unix_s + t_s) * 1000);
  return `${since} · ${[date.getHours(), date.getMinutes(), date.getSeconds()].map((n) => String(n).padStart(2, '0')).join(':')}`;
}
