/** The parameters of a flight at arming, beside those of another flight or the defaults. Beside the vehicle's they are a review. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { LogPart, FlightRecord } from './log-view.svelte';
import { titleOf, type Flight, type Row } from './library.svelte';

export interface Parameter {
  readonly name: string;
  readonly value: number;
}
/** A parameter whose values differ; null: one side does not have it. */
export interface Difference {
  readonly name: string;
  readonly mine: number | null;
  readonly other: number | null;
}
interface Comparison {
  readonly title: string;
  readonly rows: readonly Difference[];
  /** Number of parameters that both have with the same value. */
  readonly same: number;
}

/** Those of the flight's logs when it was armed, or else those that the server knew then. */
export function atArming(
  parts: readonly Pick<LogPart, 'offset_s' | 'overview'>[],
  record: Pick<FlightRecord, 'parameters'> | null,
  begin_s: number,
): readonly Parameter[] {
  const part = parts.find(({ overview: { parameters } }) => parameters.length > 0);
  if (part === undefined) return record?.parameters ?? [];
  const values = new Map(part.overview.parameters.map(({ name, value }) => [name, value]));
  for (const { t_s, name, value } of part.overview.parameter_changes) if (t_s + part.offset_s <= begin_s) values.set(name, value);
  return [...values].map(([name, value]) => ({ name, value }));
}

/** What differs, with the precision in which a vehicle stores values. @param partial `other` has only some: what it lacks is no difference. */
export function differences(mine: readonly Parameter[], other: readonly Parameter[], partial = false): Omit<Comparison, 'title'> {
  const [a, b] = [mine, other].map((each) => new Map(each.map(({ name, value }) => [name, value]))) as [Map<string, number>, Map<string, number>];
  const names = [...new Set([...a.keys(), ...(partial ? [] : b.keys())])].filter((name) => !partial || b.has(name)).sort();
  const isSame = (name: string): boolean => Math.fround(a.get(name) ?? NaN) === Math.fround(b.get(name) ?? NaN);
  const rows = names.filter((name) => !isSame(name)).map((name) => ({ name, mine: a.get(name) ?? null, other: b.get(name) ?? null }));
  return { rows, same: names.length - rows.length };
}

export class ParamCompare {
  comparison = $state.raw<Comparison | null>(null);
  problem = $state.raw<Pick<Problem, 'title' | 'detail'> | null>(null);
  isBusy = $state(false);
  private request = 0;

  constructor(private readonly api: ApiClient) {}

  reset(): void {
    this.request += 1;
    this.comparison = this.problem = null;
    this.isBusy = false;
  }

  /** Compares with another flight, whose log the server may have to read first. */
  async withFlight(mine: readonly Parameter[], row: Row): Promise<void> {
    await this.compare(mine, titleOf(row), false, () => this.parametersOf(row));
  }

  /** Compares with the defaults in the metadata of a connected vehicle's firmware. */
  async withDefaults(mine: readonly Parameter[], vehicle: string, name: string): Promise<void> {
    await this.compare(mine, `Defaults of ${name}’s firmware`, true, async () => {
      const answer = await this.api.get('/vehicles/{v}/params', { params: { path: { v: vehicle } } });
      if (!answer.ok) return answer.problem;
      const known = answer.value.params.flatMap(({ name: parameter, facts }) => (facts?.default == null ? [] : [{ name: parameter, value: facts.default }]));
      return known.length > 0 ? known : { title: 'Not known', detail: `The defaults of ${name} are not read yet: open its parameters once.` };
    });
  }

  /** Reads the parameters of a connected vehicle. @returns false: they cannot be read, or something else was chosen meanwhile. */
  async readVehicle(vehicle: string): Promise<boolean> {
    this.reset();
    const request = this.request;
    this.isBusy = true;
    const answer = await this.api.post('/vehicles/{v}/params/refresh', { params: { path: { v: vehicle } }, body: { ignore_cache: false, wait: true } });
    if (request !== this.request) return false;
    this.isBusy = false;
    if (!answer.ok) this.problem = answer.problem;
    return answer.ok;
  }

  private async compare(
    mine: readonly Parameter[],
    title: string,
    partial: boolean,
    load: () => Promise<readonly Parameter[] | Pick<Problem, 'title' | 'detail'>>,
  ): Promise<void> {
    this.reset();
    const request = this.request;
    this.isBusy = true;
    const other = await load();
    if (request !== this.request) return;
    this.isBusy = false;
    if ('title' in other) this.problem = other;
    else this.comparison = { title, ...differences(mine, other, partial) };
  }

  private async parametersOf({ flight, files }: Row): Promise<readonly Parameter[] | Pick<Problem, 'title' | 'detail'>> {
    const record = flight === null ? null : await this.api.get('/flights/{f}/joined', { params: { path: { f: flight.id } } });
    const offsets = new Map((flight?.parts ?? []).map(({ file, offset_s }) => [file, offset_s]));
    for (const { id } of files) {
      const answer = await this.api.get('/flights/{f}', { params: { path: { f: id } } });
      if (!answer.ok || answer.value.parameters.length === 0) continue;
      return atArming([{ overview: answer.value, offset_s: offsets.get(id) ?? 0 }], null, beginOf(flight));
    }
    const noted = record?.ok === true ? record.value.parameters : [];
    return noted.length > 0 ? noted : { title: 'No parameters', detail: 'Neither the logs of that flight nor the server have its parameters.' };
  }
}

/** When a flight was armed, by the clock of its first part [s]; of a whole log its start. */
export function beginOf(flight: Flight | null): number {
  return flight?.parts[0]?.begin_s ?? 0;
}
