/** Two flights over each other: a second one is drawn over the open flight, at the same times, and compared with it. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import type { LayerContent } from '../../app/map-layers.svelte';
import { POINTS, type Series } from '../../plots/plot-view.svelte';
import { RERUN } from '../../plots/sets';
import { titleOf, type Row } from './library.svelte';
import { sourcesOf, unprefixed, wholeOf, type LogPart, type LogView } from './log-view.svelte';
import { secondLayer, trackFields, trackOf, type Track } from './track';

type Schemas = components['schemas'];
export type Comparison = Schemas['TwoFlights'];
export type Align = Comparison['align'];
/** A flight whose logs were read. */
interface Opened {
  readonly row: Row;
  readonly parts: readonly LogPart[];
  readonly track: Track | null;
}

export class TwoFlights {
  /** Id of the chosen flight; empty: none. */
  chosen = $state('');
  align = $state<Align>('arming');
  /** What is added to times of the second flight [s], for `offset`. */
  offset = $state('0');
  isBusy = $state(false);
  result = $state.raw<Comparison | null>(null);
  problem = $state.raw<Pick<Problem, 'title' | 'detail'> | null>(null);
  private opened: Opened | null = null;
  private request = 0;

  constructor(
    private readonly api: ApiClient,
    private readonly view: LogView,
  ) {}

  /** Takes the second flight away. */
  reset(): void {
    this.request += 1;
    this.chosen = '';
    this.offset = '0';
    this.align = 'arming';
    this.isBusy = false;
    this.opened = this.result = this.problem = null;
    if (this.view.second !== null) this.view.showSecond(null);
  }

  /** The flights that can be laid over the open one. */
  others(rows: readonly Row[]): readonly Row[] {
    const { view } = this;
    return rows.filter((row) => row.files.length > 0 && row.id !== view.flight?.id && (row.flight !== null || row.id !== view.id));
  }

  /** The path of the second flight, with its vehicle at the cursor of the plots. */
  layer(): LayerContent | null {
    const { second, track, cursor_s } = this.view;
    return second === null ? null : secondLayer(second.track, cursor_s === null ? null : cursor_s - second.offset_s, track);
  }

  /** Reads the logs of a flight, which takes seconds the first time, and lays it over the open one. */
  async choose(row: Row): Promise<void> {
    this.reset();
    this.chosen = row.id;
    this.isBusy = true;
    const request = this.request;
    const opened = await this.open(row, () => request === this.request);
    if (request !== this.request) return;
    this.isBusy = false;
    this.opened = opened;
    if (opened !== null) await this.compare();
  }

  /** Brings the times together in another way. */
  async alignBy(align: Align): Promise<void> {
    if (align === 'offset' && this.result !== null) this.offset = String(this.result.offset_s);
    this.align = align;
    await this.compare();
  }

  get offset_s(): number | null {
    const value = Number(this.offset);
    return this.offset.trim() === '' || !Number.isFinite(value) || Math.abs(value) > 1e6 ? null : value;
  }

  /** Compares both flights, and draws the second one. */
  async compare(): Promise<void> {
    const { opened, view, align, offset_s } = this;
    const f = view.flight?.id ?? view.id;
    if (opened === null || f === null || (align === 'offset' && offset_s === null)) return;
    const request = ++this.request;
    this.isBusy = true;
    const query = { other: opened.row.id, align, ...(align === 'offset' ? { offset_s: offset_s ?? 0 } : {}) };
    const response = await this.api.get('/flights/{f}/beside', { params: { path: { f }, query } });
    if (request !== this.request) return; // another flight was opened or chosen
    this.isBusy = false;
    this.problem = response.ok ? null : response.problem;
    this.result = response.ok ? response.value : null;
    if (!response.ok) return view.showSecond(null);
    const { row, parts, track } = opened;
    const vehicle = row.flight?.vehicle ?? '';
    view.showSecond({ id: row.id, name: titleOf(row), vehicle, parts, track, offset_s: response.value.offset_s }, distancesOf(response.value));
  }

  /** Reads the logs of a flight and its path; null: its main log cannot be read. */
  private async open(row: Row, isCurrent: () => boolean): Promise<Opened | null> {
    const [first] = row.files;
    const places = row.flight?.parts ?? [{ file: first?.id ?? null, source: null, offset_s: 0 }];
    const parts: LogPart[] = [];
    for (const { file, source, offset_s } of places) {
      if (file === null) continue;
      const response = await this.api.get('/flights/{f}', { params: { path: { f: file } } });
      if (!isCurrent()) return null;
      if (response.ok) parts.push({ file, source, offset_s, overview: response.value });
      else this.problem = response.problem;
      if (parts.length === 0) return null;
    }
    return { row, parts, track: await this.trackOf(row, parts) };
  }

  private async trackOf(row: Row, parts: readonly LogPart[]): Promise<Track | null> {
    const fields = trackFields(sourcesOf(parts, row.flight));
    const part = parts[Number(/^(\d)\|/.exec(fields?.[0] ?? '')?.[1] ?? 0)];
    if (fields === null || part === undefined) return null;
    const { from_s, to_s } = wholeOf(parts, row.flight);
    const query = { field: fields.map(unprefixed), from_s: from_s - part.offset_s, to_s: to_s - part.offset_s, points: POINTS };
    const response = await this.api.get('/flights/{f}/series', { params: { path: { f: part.file }, query } });
    if (!response.ok) {
      this.problem = response.problem;
      return null;
    }
    return trackOf(response.value.series.map((each) => ({ ...each, t_s: each.t_s.map((t_s) => t_s + part.offset_s) })));
  }
}

/** How far apart both are over time: a pane of its own. */
export function distancesOf({ t_s, distance_m, over_ground_m, above_m }: Comparison): Series[] {
  const made = (label: string, values: Series['values']): Series => ({ field: `${RERUN}${label}`, unit: 'm', samples: t_s.length, t_s, values });
  return [made('Distance of the flights', distance_m), made('Distance over ground', over_ground_m), made('Second flight higher by', above_m)];
}
