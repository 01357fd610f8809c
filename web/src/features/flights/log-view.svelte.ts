/** An open log: its overview, the panes of plots, and the window of time that all panes show. */

import type { ApiClient, Outcome } from '../../api/client';
import type { components } from '../../api/schema';
import { POINTS, MAX_SERIES, PlotView, type FieldSource, type PaneContent, type Series, type States, type Window } from '../../plots/plot-view.svelte';
import type { Spectrum } from '../../plots/spectrum';
import { SETS } from '../../plots/sets';
import { plotsShown } from './plots-shown.svelte';
import { trackFields, trackOf, type Track } from './track';

type Schemas = components['schemas'];
export type Overview = Schemas['FlightOverview'];
type Flight = Schemas['JoinedFlight'];
export type FlightRecord = Schemas['FlightRecord'];
/** A log of the open flight. */
export interface LogPart {
  /** Id of the file. */
  readonly file: string;
  readonly source: Schemas['FlightPart']['source'] | null;
  /** What is added to its times to get those of the first part, which are those of all plots [s]. */
  readonly offset_s: number;
  readonly overview: Overview;
}
/** A flight that is drawn over the open one. */
export interface SecondFlight {
  readonly id: string;
  readonly name: string;
  /** System id of its vehicle; empty: not known. */
  readonly vehicle: string;
  readonly parts: readonly LogPart[];
  /** What is added to times of its first part to get those of the open flight [s]. */
  readonly offset_s: number;
  /** Its path, at times of its first part; null: it has no positions. */
  readonly track: Track | null;
}
/** A message of the vehicle, a change of its mode, or a command to it. */
export interface FlightEvent {
  readonly t_s: number;
  readonly kind: 'message' | 'mode' | 'command';
  /** MAV_SEVERITY of a message; a refused command is a warning. */
  readonly severity: number;
  readonly text: string;
  /** Who gave a command. */
  readonly by: string;
}
/** Begins the series of the second flight; a part and the field follow. */
const SECOND = 'second|';
/** Values are requested again after this pause in zooming [ms]. */
const PAUSE_MS = 60;
/** A window that ends this near to the end of a log follows it as it grows [s]. */
const AT_END_S = 1;
/** Shown before arming and after disarming [s]. */
const AROUND_S = 15;
const WARNING = 4;
const INFO = 6;

export class LogView extends PlotView {
  /** Id of the open flight; null: the list is shown. */
  id = $state<string | null>(null);
  name = $state('');
  /** The flight that is shown; null: a whole log. */
  flight = $state.raw<Flight | null>(null);
  /** What the server noted of the flight; null: not loaded. */
  record = $state.raw<FlightRecord | null>(null);
  parts = $state.raw<readonly LogPart[]>([]);
  /** The flown path; null: not loaded, or no part has positions. */
  track = $state.raw<Track | null>(null);
  /** The flight over the open one; null: none. */
  second = $state.raw<SecondFlight | null>(null);
  /** Series that are not of the log, such as those of a rerun, by their field. */
  private computed: ReadonlyMap<string, Series> = new Map();
  private timer: ReturnType<typeof setTimeout> | null = null;
  private request = 0;
  /** The window and fields of the values in `series`. */
  private loadedKey = '';

  constructor(private readonly api: ApiClient) {
    super();
  }

  /** That of the first part. */
  readonly overview = $derived<Overview | null>(this.parts[0]?.overview ?? null);
  /** The window of the whole flight, or of the whole log. */
  readonly whole = $derived<Window>(wholeOf(this.parts, this.flight));
  /** States of the vehicle of the flight, or of all vehicles of the log. */
  readonly vehicles = $derived<readonly States[]>(vehiclesOf(this.parts, this.flight));
  readonly sources = $derived<readonly FieldSource[]>(sourcesOf(this.parts, this.flight));
  readonly start_unix_s = $derived(this.overview?.start_unix_s ?? null);
  readonly events = $derived(eventsOf(this.parts, this.vehicles, this.record));

  /** Lets the server read a log, which takes seconds the first time. @returns false: it cannot be read, or another log was opened meanwhile. */
  async read(id: string, name: string): Promise<boolean> {
    this.close();
    this.id = id;
    this.name = name;
    const response = await this.api.get('/flights/{f}', { params: { path: { f: id } } });
    if (this.id !== id) return false;
    if (!response.ok) this.problem = response.problem;
    return response.ok;
  }

  /** Opens a log. @param flight the flight that is shown, with its other logs; null: the whole log. */
  async open(id: string, name: string, flight: Flight | null = null): Promise<void> {
    this.close();
    this.id = id;
    this.name = name;
    this.flight = flight;
    const places = flight?.parts.filter(({ file }) => file !== null) ?? [];
    const [main, ...others] = places.length > 0 ? places : [{ file: id, source: null, offset_s: 0 }];
    if (main === undefined || !(await this.addPart(main))) return;
    plotsShown.isOpen = true;
    this.shown = this.whole;
    this.addPane();
    if (flight === null) {
      await this.loadTrack();
      return;
    }
    const response = await this.api.get('/flights/{f}/joined', { params: { path: { f: flight.id } } });
    if (this.flight !== flight) return;
    if (response.ok) this.record = response.value;
    else this.problem = response.problem;
    for (const other of others) await this.addPart(other);
    await this.loadTrack();
  }

  /** Loads the flown path of the whole flight, of the first part that has positions. */
  private async loadTrack(): Promise<void> {
    const { flight, whole } = this;
    const fields = trackFields(this.sources);
    const index = partOf(fields?.[0] ?? '');
    const part = this.parts[index];
    if (fields === null || part === undefined) return;
    const loaded = await this.loadPart(part, index, fields, whole);
    if (loaded !== null && this.flight === flight && this.parts.includes(part)) this.track = trackOf(loaded.map(([, series]) => series));
  }

  /** Loads a part of the open flight. @returns false: it could not be loaded, or another flight was opened meanwhile. */
  private async addPart({ file, source, offset_s }: Pick<Schemas['FlightPart'], 'file' | 'offset_s'> & Pick<LogPart, 'source'>): Promise<boolean> {
    if (file === null) return false;
    const { id, flight } = this;
    const response = await this.api.get('/flights/{f}', { params: { path: { f: file } } });
    if (this.id !== id || this.flight !== flight) return false;
    if (response.ok) this.parts = [...this.parts, { file, source, offset_s, overview: response.value }];
    else this.problem = response.problem;
    return response.ok;
  }

  /**
   * Reads again what has grown. A window that reached to the end goes on doing so.
   * @param flight the shown flight as it is now; null: a whole log is shown.
   */
  async refresh(flight: Flight | null): Promise<void> {
    const { id, parts, whole, isWhole } = this;
    if (this.flight?.id !== flight?.id) return;
    const answers = await Promise.all(parts.map(({ file }) => this.api.get('/flights/{f}', { params: { path: { f: file } } })));
    if (this.id !== id || this.parts !== parts) return; // another was opened meanwhile
    const isAtEnd = this.shown.to_s >= whole.to_s - AT_END_S;
    this.flight = flight;
    this.parts = parts.map((part, i) => (answers[i]?.ok === true ? { ...part, overview: answers[i].value } : part));
    const grown_s = this.whole.to_s - whole.to_s;
    if (grown_s <= 0) return;
    this.loadedKey = '';
    if (isAtEnd) this.zoom({ from_s: this.shown.from_s + (isWhole ? 0 : grown_s), to_s: this.shown.to_s + grown_s });
    else this.requestSeries();
    await this.loadTrack();
  }

  close(): void {
    if (this.timer !== null) clearTimeout(this.timer);
    this.id = this.flight = this.record = this.problem = this.cursor_s = null;
    this.parts = [];
    this.track = this.second = null;
    plotsShown.isOpen = false;
    this.panes = [];
    this.series = this.computed = new Map();
    this.loadedKey = '';
    this.request += 1;
  }

  /** Shows what proves a statement: these panes in place of the present ones, and the time with as much before and after it. */
  showEvidence(panes: readonly (readonly string[])[], { from_s, to_s }: Window): void {
    const filled = panes.filter((fields) => fields.length > 0).map((fields) => ({ fields }));
    if (filled.length > 0) this.showPanes(filled);
    const margin_s = Math.max(2, to_s - from_s);
    this.zoom({ from_s: from_s - margin_s, to_s: to_s + margin_s });
    this.cursor_s = Math.max(this.whole.from_s, from_s);
  }

  /** Shows series that are not of the log, in place of the present panes. */
  showComputed(series: readonly Series[], panes: readonly (readonly string[])[], window: Window): void {
    this.computed = new Map(series.map((each) => [each.field, each]));
    this.series = this.computed;
    this.loadedKey = '';
    this.showPanes(panes.map((fields) => ({ fields })));
    this.zoom(window);
    this.cursor_s = window.from_s;
  }

  /** Draws a flight over the open one, or takes it away. @param series what is of both, shown in a pane of its own. */
  showSecond(second: SecondFlight | null, series: readonly Series[] = []): void {
    const isNew = this.second?.id !== second?.id;
    const own = this.panes
      .map((pane) => ({ ...pane, fields: pane.fields.filter((field) => !this.computed.has(field)) }))
      .filter(({ fields }) => fields.length > 0);
    this.second = second;
    this.computed = new Map(series.map((each) => [each.field, each]));
    this.series = new Map([...this.series].filter(([field]) => !field.startsWith(SECOND)).concat([...this.computed]));
    this.loadedKey = '';
    if (!isNew) this.requestSeries();
    else this.showPanes([...(series.length === 0 ? [] : [{ fields: [...this.computed.keys()] }]), ...(own.length === 0 ? this.usualPanes() : own)]);
  }

  /** What is shown of two flights if a person has chosen nothing. */
  private usualPanes(): PaneContent[] {
    const panes = SETS.slice(0, 1).flatMap((set) => this.fieldsOf(set));
    return (panes.length === 0 ? [[]] : panes).map((fields) => ({ fields }));
  }

  /** The same field of the second flight, of its first part that has it. */
  override beside(field: string): string | null {
    const { second } = this;
    if (second === null || this.computed.has(field)) return null;
    const own = this.flight?.vehicle ?? '';
    const named = unprefixed(field);
    const index = second.parts.findIndex(({ overview }) => hasFields(overview, otherVehicle(named, own, second.vehicle)));
    return index < 0 ? null : `${SECOND}${index}|${otherVehicle(named, own, second.vehicle)}`;
  }

  override get hasSpectra(): boolean {
    return true;
  }

  override async loadSpectrum(field: string, { from_s, to_s }: Window): Promise<Outcome<Spectrum> | null> {
    const isSecond = field.startsWith(SECOND);
    const own = isSecond ? field.slice(SECOND.length) : field;
    const part = this.computed.has(field) ? undefined : (isSecond ? this.second?.parts : this.parts)?.[partOf(own)];
    if (part === undefined) return null;
    const { file } = part;
    const offset_s = part.offset_s + (isSecond ? (this.second?.offset_s ?? 0) : 0);
    const query = { field: unprefixed(own), from_s: from_s - offset_s, to_s: to_s - offset_s };
    const answer = await this.api.get('/flights/{f}/spectrum', { params: { path: { f: file }, query } });
    if (!answer.ok) return answer;
    return { ok: true, value: { ...answer.value, field, t_s: answer.value.t_s.map((t_s) => t_s + offset_s) } };
  }

  protected requestSeries(): void {
    if (this.timer !== null) clearTimeout(this.timer);
    this.timer = setTimeout(() => void this.loadSeries(), PAUSE_MS);
  }

  /** Requests the values of all fields in the shown window, unless the page has them. */
  async loadSeries(): Promise<void> {
    const { id, shown } = this;
    const fields = this.plotted.filter((field) => !this.computed.has(field)).slice(0, MAX_SERIES);
    const others = [...new Set(fields.flatMap((field) => this.beside(field) ?? []))];
    const { second } = this;
    const key = JSON.stringify([id, shown, fields, others, second?.offset_s]);
    if (id === null || fields.length === 0 || key === this.loadedKey) return;
    const request = ++this.request;
    const loaded = await Promise.all([
      ...this.parts.map((part, i) => this.loadPart(part, i, fields, shown)),
      ...(second?.parts.map((part, i) => this.loadPart(part, i, others, shown, second)) ?? []),
    ]);
    if (request !== this.request) return;
    const series = loaded.flatMap((each) => each ?? []);
    if (loaded.includes(null)) return; // `problem` says why
    this.problem = null;
    this.loadedKey = key;
    this.series = new Map([...this.computed, ...series]);
  }

  /** The values of those fields that are of this part, at times of the first part; null: they could not be loaded. */
  private async loadPart(
    part: LogPart,
    index: number,
    fields: readonly string[],
    shown: Window,
    second: SecondFlight | null = null,
  ): Promise<[string, Series][] | null> {
    const begin = second === null ? 0 : SECOND.length;
    const own = fields.filter((field) => partOf(field.slice(begin)) === index);
    if (own.length === 0) return [];
    const offset_s = part.offset_s + (second?.offset_s ?? 0);
    const names = own.map((field) => unprefixed(field.slice(begin)));
    const query = { field: names, from_s: shown.from_s - offset_s, to_s: shown.to_s - offset_s, points: POINTS };
    const response = await this.api.get('/flights/{f}/series', { params: { path: { f: part.file }, query } });
    if (second === null ? !this.parts.includes(part) : this.second !== second) return null;
    if (!response.ok) {
      this.problem = response.problem;
      return null;
    }
    return response.value.series.map((each, i) => [own[i] ?? each.field, { ...each, t_s: offset_s === 0 ? each.t_s : each.t_s.map((t_s) => t_s + offset_s) }]);
  }
}

/** Index of the part of a field or expression: `1|ATTITUDE:1.1/roll` is of the second part. */
function partOf(field: string): number {
  return Number(/^(\d)\|/.exec(field)?.[1] ?? 0);
}

/** A field or expression as its part names it. */
export function unprefixed(field: string): string {
  return field.replace(/^\d\|/, '');
}

/** A field or expression of another vehicle: a recording's topics have the system id. */
function otherVehicle(field: string, own: string, other: string): string {
  return own === '' || other === '' || own === other ? field : field.replaceAll(`:${own}.`, `:${other}.`);
}

/** Whether a log has all fields of a field or expression. */
function hasFields({ topics }: Overview, field: string): boolean {
  const names = field.includes('{') ? [...field.matchAll(/\{([^}]*)\}/g)].map(([, name = '']) => name) : [field];
  return names.every((name) => {
    const at = name.indexOf('/');
    return topics.find(({ id }) => id === name.slice(0, at))?.fields.some((each) => each.name === name.slice(at + 1)) === true;
  });
}

export function wholeOf(parts: readonly LogPart[], flight: Flight | null): Window {
  const begin_s = Math.min(0, ...parts.map(({ offset_s }) => offset_s));
  const end_s = Math.max(0.1, ...parts.map(({ offset_s, overview }) => offset_s + overview.duration_s));
  const main = flight?.parts[0];
  if (main === undefined) return { from_s: 0, to_s: Math.max(0.1, parts[0]?.overview.duration_s ?? 1) };
  return { from_s: Math.max(begin_s, main.begin_s - AROUND_S), to_s: Math.min(end_s, main.end_s + AROUND_S) };
}

function vehiclesOf(parts: readonly LogPart[], flight: Flight | null): readonly States[] {
  const shifted = parts.map(({ overview, offset_s }) => {
    const at = <T extends { begin_s: number; end_s: number }>(span: T): T => ({ ...span, begin_s: span.begin_s + offset_s, end_s: span.end_s + offset_s });
    return overview.vehicles.map((v) => ({ ...v, modes: v.modes.map(at), armed: v.armed.map(at), failsafe: v.failsafe.map(at) }));
  });
  if (flight === null) return shifted[0] ?? [];
  const own = shifted.flatMap((vehicles) => vehicles.filter(({ id, modes }) => (id === flight.vehicle || id === '') && modes.length > 0));
  return own.slice(0, 1);
}

export function sourcesOf(parts: readonly LogPart[], flight: Flight | null): readonly FieldSource[] {
  return parts.map(({ source, overview }, i) => {
    const isOwn = flight !== null && flight.vehicle !== '' && overview.kind === 'tlog';
    const topics = isOwn ? overview.topics.filter(({ instance }) => instance.startsWith(`${flight.vehicle}.`)) : overview.topics;
    return { source, prefix: i === 0 ? '' : `${i}|`, topics };
  });
}

function eventsOf(parts: readonly LogPart[], vehicles: readonly States[], record: FlightRecord | null): readonly FlightEvent[] {
  const main = parts.find(({ overview }) => overview.messages.length > 0);
  const messages = (main?.overview.messages ?? []).map(({ t_s, severity, text }): FlightEvent => ({
    t_s: t_s + (main?.offset_s ?? 0),
    kind: 'message',
    severity,
    text,
    by: '',
  }));
  const modes = vehicles.flatMap((vehicle) =>
    vehicle.modes.map(({ begin_s, name }): FlightEvent => ({ t_s: begin_s, kind: 'mode', severity: INFO, text: name, by: '' })),
  );
  const commands = (record?.commands ?? []).map(({ t_s, client, command, result, detail }): FlightEvent => {
    const isOk = result === 'ok';
    return { t_s, kind: 'command', severity: isOk ? INFO : WARNING, text: isOk ? command : `${command}: ${detail ?? result}`, by: client };
  });
  return [...messages, ...modes, ...commands].sort((a, b) => a.t_s - b.t_s);
}
