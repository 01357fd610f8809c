/** The list of flights: recordings and logs on the server; adding and deleting files. */

import type { ApiClient, Outcome } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import { dateTime, distanceText, durationText, heightText, join, sizeText } from '../../ui/format';

type Schemas = components['schemas'];
export type FlightList = Schemas['FlightList'];
export type Flight = Schemas['JoinedFlight'];
export type LogFile = Schemas['FlightFile'];

/** A row of the list: a flight with its files, or a file without a flight. */
export interface Row {
  /** Of the flight, or else of the file. */
  readonly id: string;
  readonly flight: Flight | null;
  /** Those of the flight's parts, the main one first. */
  readonly files: readonly LogFile[];
}

export class FlightLibrary {
  list = $state.raw<FlightList | null>(null);
  problem = $state.raw<Pick<Problem, 'title' | 'detail'> | null>(null);
  search = $state('');
  /** The file that is being added, and the part of it that the server has, 0 to 1. */
  adding = $state.raw<{ readonly name: string; readonly fraction: number } | null>(null);
  /** Id of the row whose deletion a person is asked to confirm. */
  toDelete = $state<string | null>(null);
  /** Id of the flight that a person is naming. */
  toName = $state<string | null>(null);

  private deletingId: string | null = null;
  private isChanging = false;

  constructor(private readonly api: ApiClient) {}

  readonly rows = $derived(this.list === null ? [] : rowsOf(this.list));
  readonly found = $derived(matching(this.rows, this.search));

  async load(): Promise<void> {
    const response = await this.api.get('/flights');
    if (response.ok) this.list = response.value;
    this.problem = response.ok ? null : response.problem;
  }

  /** Sends a file in parts. @returns the id of its flight; null: it was not added, and `problem` says why. */
  async add(file: File): Promise<string | null> {
    if (this.adding !== null) return null;
    this.problem = null;
    this.adding = { name: file.name, fraction: 0 };
    try {
      return await this.send(file);
    } finally {
      this.adding = null;
      const { problem } = this;
      await this.load();
      this.problem ??= problem;
    }
  }

  private async send(file: File): Promise<string | null> {
    const begun = await this.api.post('/flights/uploads', { body: { name: file.name, bytes: file.size } });
    if (!begun.ok) {
      this.problem = begun.problem;
      return null;
    }
    const { id, part_bytes } = begun.value;
    for (let offset = 0; ; offset += part_bytes) {
      const path = { params: { path: { u: id }, query: { offset_bytes: offset } } };
      const part = file.slice(offset, offset + part_bytes);
      const headers = { 'Content-Type': 'application/octet-stream' };
      const sent = await this.api.post('/flights/uploads/{u}', { ...path, body: part, bodySerializer: (body) => body, headers });
      if (!sent.ok) {
        this.problem = sent.problem;
        await this.api.delete('/flights/uploads/{u}', { params: { path: { u: id } } });
        return null;
      }
      if (sent.value.flight !== null) return sent.value.flight;
      this.adding = { name: file.name, fraction: sent.value.received_bytes / file.size };
    }
  }

  async delete(id: string): Promise<boolean> {
    this.toDelete = null;
    if (this.deletingId === id) return false;
    this.deletingId = id;
    const response = await this.api.delete('/flights/{f}', { params: { path: { f: id }, query: { confirm: `flight ${id} is deleted` } } });
    this.deletingId = null;
    if (response.ok) await this.load();
    else this.problem = response.problem;
    return response.ok;
  }

  /** Names a flight; an empty name takes it away. */
  setName(id: string, name: string): Promise<boolean> {
    this.toName = null;
    return this.change(() => this.api.post('/flights/{f}/name', { params: { path: { f: id } }, body: { name } }));
  }

  /** Joins a part of another flight to a flight, or separates one of its parts. */
  decide(id: string, part: string, joined: boolean): Promise<boolean> {
    return this.change(() => this.api.post('/flights/{f}/parts', { params: { path: { f: id } }, body: { part, joined } }));
  }

  /** One change at a time: a second click before the answer has no effect. */
  private async change(send: () => Promise<Outcome<unknown>>): Promise<boolean> {
    if (this.isChanging) return false;
    this.isChanging = true;
    const response = await send();
    this.isChanging = false;
    if (response.ok) await this.load();
    else this.problem = response.problem;
    return response.ok;
  }
}

/** The rows of the list, the newest first. */
function rowsOf(list: FlightList): readonly Row[] {
  const files = new Map(list.files.map((file) => [file.id, file]));
  const rows: Row[] = list.flights.map((flight) => ({ id: flight.id, flight, files: flight.parts.flatMap(({ file }) => files.get(file ?? '') ?? []) }));
  const flown = new Set(rows.flatMap((row) => row.files.map(({ id }) => id)));
  rows.push(...list.files.filter(({ id }) => !flown.has(id)).map((file) => ({ id: file.id, flight: null, files: [file] })));
  return rows.sort((a, b) => timeOf(b) - timeOf(a));
}

function timeOf({ flight, files }: Row): number {
  return flight?.start_unix_s ?? files[0]?.start_unix_s ?? files[0]?.added_unix_s ?? 0;
}

/** The rows that contain all words of a text. */
export function matching(rows: readonly Row[], text: string): readonly Row[] {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  return rows.filter((row) => {
    const names = row.files.map(({ name }) => name).join(' ');
    const searched = `${names} ${titleOf(row)} ${row.flight?.plan ?? ''} ${detailsOf(row)} ${sourcesOf(row)}`.toLowerCase();
    return words.every((word) => searched.includes(word));
  });
}

/** The flight's name, when it began, or the name of its file. */
export function titleOf({ flight, files }: Row): string {
  if (flight?.name != null) return flight.name;
  const start_unix_s = flight?.start_unix_s ?? files[0]?.start_unix_s ?? null;
  return start_unix_s === null ? (files[0]?.name ?? 'Flight') : dateTime(start_unix_s);
}

const ENDED_WORDS: Readonly<Record<Flight['ended'], string>> = {
  landed: 'landed',
  disarmed: 'disarmed',
  disarmed_in_air: 'disarmed in the air',
  log_ends: 'the logs end in flight',
};
const SOURCE_WORDS: Readonly<Record<Schemas['FlightPart']['source'], string>> = {
  recording: 'recording',
  vehicle: 'log of the vehicle',
  file: 'added log',
  notes: 'notes of the server',
};
export const sourceText = (source: Schemas['FlightPart']['source']): string => SOURCE_WORDS[source];

/** Vehicle, duration, distance, height, modes and end of a flight, or what is known of a file, in one line. */
export function detailsOf({ flight, files: [file] }: Row): string {
  if (flight === null) {
    const vehicles =
      file === undefined || file.vehicles.length === 0 ? '' : `${file.vehicles.length === 1 ? 'vehicle' : 'vehicles'} ${file.vehicles.join(', ')}`;
    return join([vehicles, file?.duration_s == null ? '' : durationText(file.duration_s), file?.read === true && file.problem === null ? 'not armed' : '']);
  }
  return join([
    flight.name === null || flight.start_unix_s === null ? '' : dateTime(flight.start_unix_s),
    flight.vehicle === '' ? '' : `vehicle ${flight.vehicle}`,
    durationText(flight.duration_s),
    flight.distance_m === null ? '' : distanceText(flight.distance_m),
    flight.height_m === null ? '' : `${heightText(flight.height_m, 0)} high`,
    flight.modes.join(', '),
    ENDED_WORDS[flight.ended],
  ]);
}

/** Which files a row has, and their size. */
export function sourcesOf({ files }: Row): string {
  const bytes = files.reduce((sum, file) => sum + file.bytes, 0);
  return files.length === 0 ? '' : join([[...new Set(files.map(({ source }) => sourceText(source)))].join(', '), sizeText(bytes)]);
}

/** What was deleted to make room, as a sentence; null: nothing. */
export function removedText(list: FlightList | null): string | null {
  const [newest, ...others] = list?.removed ?? [];
  if (list === null || newest === undefined) return null;
  const rest = others.length === 0 ? '' : ` and ${others.length} more before it`;
  return `To stay within ${sizeText(list.max_bytes)}, the server deleted ${newest.name} on ${dateTime(newest.unix_s)}${rest}.`;
}
