/** The values of an open log as a table, and its files for other programs. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import { unprefixed, type LogPart, type LogView } from './log-view.svelte';
import type { Window } from '../../plots/plot-view.svelte';
import { RERUN } from '../../plots/sets';

export type Table = components['schemas']['FlightTable'];
export type Format = 'csv' | 'parquet' | 'geojson' | 'kml' | 'mcap';
export interface Export {
  readonly format: Format;
  readonly topic?: string[];
  readonly field?: string[];
  readonly rate_hz?: number;
}

export const PAGE_ROWS = 50;

export class Values {
  /** Index of the part whose values are shown, and the id of its topic. */
  part = $state(0);
  topic = $state('');
  table = $state.raw<Table | null>(null);
  problem = $state.raw<Pick<Problem, 'title' | 'detail'> | null>(null);
  /** Whether files have only what the plots show. */
  onlyShown = $state(false);
  /** Rows a second of the plotted fields; empty: at the samples of the first. */
  rate = $state('');
  /** The file that is being asked for. */
  asking = $state<Format | null>(null);
  private request = 0;

  constructor(
    private readonly api: ApiClient,
    private readonly view: LogView,
    /** Lets the browser save the answer of a URL. */
    private readonly save: (url: string) => void,
  ) {}

  get shownPart(): LogPart | undefined {
    return this.view.parts[this.part] ?? this.view.parts[0];
  }

  /** The plotted fields of the shown part, as its log names them; a rerun's are of no log. */
  get plotted(): string[] {
    const fields = [...new Set(this.view.panes.flatMap((pane) => pane.fields))];
    const own = fields.filter((field) => (/^(\d)\|/.exec(field)?.[1] ?? '0') === String(this.part) && !field.startsWith(RERUN));
    return own.map(unprefixed).slice(0, 32);
  }

  /** Forgets what is of another log. */
  reset(): void {
    this.request += 1;
    this.part = 0;
    this.topic = '';
    this.table = this.problem = null;
    this.asking = null;
  }

  async choose(part: number, topic: string): Promise<void> {
    this.part = part;
    this.topic = topic;
    await this.load({ from_row: 0 });
  }

  /** Shows rows from a number, or from a time of the plots on. */
  async load(begin: { from_row: number } | { at_s: number }): Promise<void> {
    const { shownPart, topic } = this;
    if (shownPart === undefined || topic === '') return;
    const request = ++this.request;
    const from = 'at_s' in begin ? { at_s: begin.at_s - shownPart.offset_s } : begin;
    const query = { topic, rows: PAGE_ROWS, ...from };
    const response = await this.api.get('/flights/{f}/table', { params: { path: { f: shownPart.file }, query } });
    if (request !== this.request) return;
    this.problem = response.ok ? null : response.problem;
    this.table = response.ok ? response.value : null;
  }

  /** Saves a file, once the server has begun to write it: what is wrong with the request is then said here. */
  async export(wanted: Export): Promise<void> {
    const { shownPart } = this;
    if (shownPart === undefined || this.asking !== null) return;
    this.asking = wanted.format;
    const window: Window | null = this.onlyShown ? this.view.shown : null;
    const times = window === null ? {} : { from_s: window.from_s - shownPart.offset_s, to_s: window.to_s - shownPart.offset_s };
    const query = { ...wanted, ...times };
    const response = await this.api.get('/flights/{f}/export', { params: { path: { f: shownPart.file }, query }, parseAs: 'stream' });
    this.asking = null;
    this.problem = response.ok ? null : response.problem;
    if (!response.ok) return;
    await (response.value as ReadableStream | null)?.cancel();
    this.save(`/api/v1/flights/${encodeURIComponent(shownPart.file)}/export?${queryText(query)}`);
  }
}

function queryText(query: object): string {
  const pairs = Object.entries(query).flatMap(([name, value]: [string, unknown]) =>
    (Array.isArray(value) ? value : [value]).map((each) => [name, String(each)]),
  );
  return new URLSearchParams(pairs).toString();
}

/** A value of the table as text. */
export function cellText(value: string | number | boolean | null | undefined): string {
  if (value == null) return '–';
  if (typeof value !== 'number') return String(value);
  return (Number.isInteger(value) ? String(value) : String(Number(value.toPrecision(7)))).replace('-', '−');
}
