/** The list of flights: recordings and logs on the server; adding and deleting files. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import { dateTime, durationText, sizeText } from '../../ui/format';

type Schemas = components['schemas'];
export type Flight = Schemas['FlightFile'];
export type FlightList = Schemas['FlightList'];

export class FlightLibrary {
  list = $state.raw<FlightList | null>(null);
  problem = $state.raw<Pick<Problem, 'title' | 'detail'> | null>(null);
  search = $state('');
  /** The file that is being added, and the part of it that the server has, 0 to 1. */
  adding = $state.raw<{ readonly name: string; readonly fraction: number } | null>(null);
  /** Id of the flight whose deletion a person is asked to confirm. */
  toDelete = $state<string | null>(null);

  private deletingId: string | null = null;

  constructor(private readonly api: ApiClient) {}

  readonly found = $derived(matching(this.list?.flights ?? [], this.search));

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
}

/** The flights that contain all words of a text. */
export function matching(flights: readonly Flight[], text: string): readonly Flight[] {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  return flights.filter((flight) => {
    const searched = `${flight.name} ${titleOf(flight)} ${detailsOf(flight)}`.toLowerCase();
    return words.every((word) => searched.includes(word));
  });
}

/** When a flight began, or the name of its file. */
export function titleOf(flight: Flight): string {
  return flight.start_unix_s === null ? flight.name : dateTime(flight.start_unix_s);
}

const SOURCE_WORDS: Readonly<Record<Flight['source'], string>> = { recording: 'recording', vehicle: 'log of the vehicle', file: 'added log' };

/** Vehicles, duration, kind and size of a flight in one line. */
export function detailsOf(flight: Flight): string {
  const vehicles = flight.vehicles.length === 0 ? '' : `${flight.vehicles.length === 1 ? 'vehicle' : 'vehicles'} ${flight.vehicles.join(', ')}`;
  const parts = [vehicles, flight.duration_s === null ? '' : durationText(flight.duration_s), SOURCE_WORDS[flight.source], sizeText(flight.bytes)];
  return parts.filter((part) => part !== '').join(' · ');
}

/** What was deleted to make room, as a sentence; null: nothing. */
export function removedText(list: FlightList | null): string | null {
  const [newest, ...others] = list?.removed ?? [];
  if (list === null || newest === undefined) return null;
  const rest = others.length === 0 ? '' : ` and ${others.length} more before it`;
  return `To stay within ${sizeText(list.max_bytes)}, the server deleted ${newest.name} on ${dateTime(newest.unix_s)}${rest}.`;
}
