/** Plots of a vehicle that flies: numbers of its messages as they arrive, in a window that moves with the time. */

import type { ApiClient } from '../api/client';
import type { components } from '../api/schema';
import type { VehicleFacts } from '../vehicle/facts';
import { LiveBuffer } from './live-buffer';
import { MAX_SERIES, MIN_WINDOW_S, PlotView, POINTS, type FieldSource, type Series, type States, type Window } from './plot-view.svelte';

type Schemas = components['schemas'];
export type Received = Schemas['ReceivedMessages'];

/** Lengths of the moving window that a person can choose [s]. */
export const LENGTHS_S: readonly number[] = [10, 30, 60, 120, 300, 600, 1800];
/** What is older is forgotten [s]. */
const KEPT_S = 1800;
const POLL_MS = 250;
const LIST_MS = 2000;
/** An answer has a part of what arrived; at most so many are read in turn. */
const MAX_ANSWERS = 20;
const MAX_SPANS = 300;
/** MAV_STATE_CRITICAL; PX4 reports it, or a worse one, in a failsafe. */
const CRITICAL = 5;
/** Status of an answer that says that there is no such field. */
const REFUSED = 422;

/** What the bands of a live plot show. */
export interface State {
  readonly mode: string;
  readonly armed: boolean;
  readonly failsafe: boolean;
}

/** The state of a vehicle for the bands; null: not known. */
export function stateOf(facts: VehicleFacts | null): State | null {
  const status = facts === null || facts.lost ? null : (facts.status?.value ?? null);
  return status === null ? null : { mode: status.mode_label, armed: status.armed, failsafe: status.system_status >= CRITICAL };
}

export class LiveView extends PlotView {
  /** Id of the vehicle; null: closed. */
  vehicle = $state<string | null>(null);
  name = $state('');
  /** Length of the moving window [s]. */
  length_s = $state(60);
  /** The window stands still, while values go on to arrive. */
  isPaused = $state(false);
  /** Fields and expressions that the server does not have, and why. */
  failed = $state.raw<ReadonlyMap<string, string>>(new Map());
  vehicles = $state.raw<readonly States[]>([]);
  sources = $state.raw<readonly FieldSource[]>([]);
  start_unix_s = $state<number | null>(null);
  /** Time of the newest answer since the first [s]. */
  private now_s = $state(0);
  /** Time of the first answer, on the server's clock [s]. */
  private begin_s: number | null = null;
  private after = 0;
  private readonly buffers = new Map<string, LiveBuffer>();
  private reading = false;

  constructor(private readonly api: ApiClient) {
    super();
  }

  readonly whole = $derived<Window>({ from_s: Math.max(0, this.now_s - KEPT_S), to_s: Math.max(this.now_s, 1) });

  override get newest_s(): number | null {
    return this.isPaused ? this.shown.to_s : this.now_s;
  }

  override get failures(): ReadonlyMap<string, string> {
    return this.failed;
  }

  override get isWhole(): boolean {
    return this.isPaused ? this.shown.to_s - this.shown.from_s >= this.whole.to_s - this.whole.from_s - 1e-6 : this.length_s >= KEPT_S;
  }

  /** Shows a vehicle; its values arrive while `watch` is called. */
  open(vehicle: string, name: string, panes: readonly (readonly string[])[] = [[]]): void {
    this.close();
    this.vehicle = vehicle;
    this.name = name;
    this.showPanes(panes.map((fields) => ({ fields })));
  }

  /**
   * Receives the messages of the vehicle until the returned function is called.
   * @param state what its bands show now. @param isListed whether a person chooses from a list of the messages.
   */
  watch(state: () => State | null, isListed = true): () => void {
    if (isListed) void this.list();
    const timers = [
      setInterval(() => {
        this.note(state());
        void this.read();
      }, POLL_MS),
      ...(isListed ? [setInterval(() => void this.list(), LIST_MS)] : []),
    ];
    return () => {
      for (const timer of timers) clearInterval(timer);
    };
  }

  close(): void {
    this.vehicle = this.problem = this.cursor_s = this.start_unix_s = this.begin_s = null;
    this.panes = this.vehicles = this.sources = [];
    this.series = this.failed = new Map();
    this.buffers.clear();
    this.isPaused = false;
    this.now_s = this.after = 0;
  }

  override get savedLength_s(): number {
    return this.length_s;
  }

  override showLength(length_s: number | null): void {
    this.setLength(length_s ?? this.length_s);
  }

  /** Shows the newest values again. */
  resume(): void {
    this.isPaused = false;
    this.show();
  }

  pause(): void {
    this.isPaused = true;
  }

  /** Sets the length of the moving window. */
  setLength(length_s: number): void {
    this.length_s = Math.min(KEPT_S, Math.max(2, length_s));
    this.resume();
  }

  /** Shows a window of what is kept; it no longer moves. */
  override zoom(window: Window): void {
    this.isPaused = true;
    super.zoom(window);
  }

  override zoomBy(factor: number): void {
    if (this.isPaused) super.zoomBy(factor);
    else this.setLength(this.length_s * factor);
  }

  override toggle(field: string, paneId = this.activePane): void {
    const failed = new Map(this.failed);
    if (failed.delete(field)) this.failed = failed;
    super.toggle(field, paneId);
  }

  protected requestSeries(): void {
    for (const field of this.buffers.keys()) if (!this.plotted.includes(field)) this.buffers.delete(field);
    this.show();
  }

  /** Adds the present state to the bands. */
  note(state: State | null): void {
    const { now_s, vehicle } = this;
    if (this.begin_s === null || vehicle === null) return;
    const before = this.vehicles[0] ?? { id: vehicle, modes: [], armed: [], failsafe: [] };
    this.vehicles = [
      {
        id: vehicle,
        modes: continued(before.modes, now_s, state?.mode ?? null),
        armed: continued(before.armed, now_s, state?.armed === true ? 'Armed' : null),
        failsafe: continued(before.failsafe, now_s, state?.failsafe === true ? 'Failsafe' : null),
      },
    ];
  }

  /** Reads which messages arrive. */
  async list(): Promise<void> {
    const { vehicle } = this;
    if (vehicle === null) return;
    const answer = await this.api.get('/vehicles/{v}/mavlink', { params: { path: { v: vehicle } } });
    if (answer.ok && this.vehicle === vehicle) this.sources = [{ source: null, prefix: '', topics: topicsOf(answer.value) }];
  }

  /** Reads what has arrived of all plotted fields. */
  async read(): Promise<void> {
    const fields = this.plotted.filter((field) => !this.failed.has(field)).slice(0, MAX_SERIES);
    if (this.reading || this.vehicle === null || fields.length === 0) return;
    this.reading = true;
    try {
      const known = fields.filter((field) => this.buffers.has(field));
      const fresh = fields.filter((field) => !this.buffers.has(field));
      const afters = [await this.readAll(known, this.after), await this.readFresh(fresh)].filter((after) => after !== null);
      if (afters.length > 0) this.after = Math.min(...afters);
    } finally {
      this.reading = false;
    }
    if (!this.isPaused) this.show();
  }

  /** Reads fields for the first time; those that the server does not have are named. */
  private async readFresh(fields: readonly string[]): Promise<number | null> {
    const after = await this.readAll(fields, 0);
    if (after !== null || fields.length === 0 || this.problem?.status !== REFUSED) return after;
    if (fields.length === 1 && fields[0] !== undefined) {
      this.failed = new Map([...this.failed, [fields[0], this.problem.detail]]);
      return null;
    }
    const afters: (number | null)[] = [];
    for (const field of fields) afters.push(await this.readFresh([field]));
    return afters.find((each) => each !== null) ?? null;
  }

  /** @returns `after` of the next request; null: there was no answer, or nothing was asked. */
  private async readAll(fields: readonly string[], first: number): Promise<number | null> {
    const { vehicle } = this;
    if (vehicle === null || fields.length === 0) return null;
    let after = first;
    for (let i = 0; i < MAX_ANSWERS; i += 1) {
      const query = { field: [...fields], after };
      const answer = await this.api.get('/vehicles/{v}/mavlink/series', { params: { path: { v: vehicle }, query } });
      if (this.vehicle !== vehicle) return null;
      if (!answer.ok) {
        this.problem = answer.problem;
        return null;
      }
      this.problem = null;
      this.take(answer.value);
      after = answer.value.after;
      if (!answer.value.more) break;
    }
    return after;
  }

  private take({ now_s, series }: Schemas['LiveValues']): void {
    if (this.begin_s === null || now_s - this.begin_s < this.now_s - 1) {
      this.begin_s = now_s; // the first answer, or the server's computer was started again
      this.start_unix_s = Date.now() / 1000;
      this.buffers.clear();
      this.vehicles = [];
    }
    const { begin_s } = this;
    this.now_s = now_s - begin_s;
    for (const { field, unit, gap, t_s, values } of series) {
      const buffer = this.buffers.get(field) ?? new LiveBuffer();
      buffer.unit = unit;
      buffer.add({ t_s: t_s.map((each) => each - begin_s), values }, gap);
      buffer.forgetBefore(this.now_s - KEPT_S);
      if (this.plotted.includes(field)) this.buffers.set(field, buffer);
    }
  }

  /** Shows the values of the window, which moves unless it is paused. */
  private show(): void {
    if (!this.isPaused) this.shown = { from_s: this.now_s - this.length_s, to_s: Math.max(this.now_s, MIN_WINDOW_S) };
    const { from_s, to_s } = this.shown;
    const series = new Map<string, Series>();
    for (const [field, buffer] of this.buffers) {
      const points = buffer.within(from_s, to_s, POINTS);
      series.set(field, { field, unit: buffer.unit, samples: points.t_s.length, t_s: points.t_s, values: points.values });
    }
    this.series = series;
  }
}

/** The spans of a state, with the present one continued until now; null: in none. */
export function continued(spans: States['modes'], now_s: number, name: string | null): States['modes'] {
  const last = spans.at(-1);
  const isSame = last !== undefined && last.name === name && now_s - last.end_s < 2;
  const kept = spans.slice(-MAX_SPANS, isSame ? -1 : undefined).filter(({ end_s }) => end_s > now_s - KEPT_S);
  if (name === null) return kept;
  return [...kept, { begin_s: isSame ? last.begin_s : now_s, end_s: now_s, name }];
}

/** The messages as topics of a log, with the numbers that can be plotted. */
export function topicsOf({ system, messages }: Received): FieldSource['topics'] {
  return messages.flatMap(({ name, component, count, rate_hz, fields, instances }) => {
    if (name === null || fields === null) return [];
    const numbers = Object.entries(fields).flatMap(([field, value]) => {
      if (Array.isArray(value)) return value.map((_, i) => `${field}[${i}]`);
      return typeof value === 'string' ? [] : [field];
    });
    if (numbers.length === 0) return [];
    const senders = instances.length === 0 ? [`${system}.${component}`] : instances.map((instance) => `${system}.${component}.${instance}`);
    return senders.map((instance) => ({
      id: `${name}:${instance}`,
      name,
      instance,
      samples: count,
      begin_s: 0,
      end_s: 0,
      rate_hz,
      fields: numbers.map((number) => ({ name: number, unit: null, type: '' })),
    }));
  });
}
