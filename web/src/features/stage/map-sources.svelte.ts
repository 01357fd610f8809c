/** The map sources of the server: choosing one, adding own ones, and saving what the map shows for the field. */

import type { ApiClient, Outcome } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import { CommandGate, DOUBLE_CLICK } from '../../app/actions/command.svelte';

export type MapSource = components['schemas']['MapSourceView'];
type SourceList = components['schemas']['MapSourceList'];
type Operation = components['schemas']['Operation'];
type RegionRequest = components['schemas']['RegionRequest'];

const POLL_MS = 400;

export class MapSources {
  private list = $state.raw<SourceList | null>(null);
  problem = $state.raw<Pick<Problem, 'title' | 'detail'> | null>(null);
  /** The region whose size was asked for, which is then saved; null: none. */
  measured = $state.raw<{ region: RegionRequest; tiles: number; estimated_bytes: number } | null>(null);
  /** The saving of a region that this page has started. */
  saving = $state.raw<Operation | null>(null);

  constructor(
    private readonly api: ApiClient,
    private readonly gate = new CommandGate(),
  ) {}

  get sources(): readonly MapSource[] | null {
    return this.list?.sources ?? null;
  }

  get chosen(): MapSource | null {
    return this.list?.sources.find((each) => each.id === this.list?.chosen) ?? null;
  }

  /** Another browser may have chosen or changed a source while the list is open. */
  async refresh(): Promise<void> {
    if (this.list !== null) await this.read();
  }

  async read(): Promise<void> {
    this.take(await this.api.get('/map_sources'), (list) => (this.list = list));
  }

  async choose(source: string | null): Promise<void> {
    this.measured = null;
    const response = await this.command('Choose a map source', () => this.api.put('/map_sources/chosen', { body: { source } }));
    this.take(response, (list) => (this.list = list));
  }

  /** Adds a source and chooses it. Returns whether the server accepted it. */
  async add(source: { name: string; url: string; attribution: string; may_save: boolean }): Promise<boolean> {
    let id: string | null = null;
    const body = { ...source, max_zoom: 19 };
    this.take(await this.command('Add a map source', () => this.api.post('/map_sources', { body })), (added) => (id = added.id));
    if (id === null) return false;
    await this.choose(id);
    return true;
  }

  async remove(source: MapSource): Promise<void> {
    const path = { s: source.id };
    if (!this.take(await this.command('Remove a map source', () => this.api.delete('/map_sources/{s}', { params: { path } })))) return;
    await this.read();
  }

  /** Asks how large a region is. @param region null: the map is not large, so nobody sees what would be saved. */
  async measure(region: RegionRequest | null): Promise<void> {
    this.measured = null;
    this.saving = null;
    if (region === null) this.problem = { title: 'The map is small', detail: 'Make it large (M) and show the area that you want to save.' };
    else this.take(await this.api.post('/map_regions/size', { body: region }), (size) => (this.measured = { region, ...size }));
  }

  /** Saves the measured region, and follows the saving to its end. */
  async save(name: string): Promise<void> {
    const { measured } = this;
    if (measured === null || this.saving?.state === 'running') return;
    const region = { ...measured.region, name };
    const started = await this.command('Save an area', () => this.api.post('/map_regions', { body: region }));
    if (!this.take(started, (operation) => (this.saving = operation))) return;
    for (let current = this.saving; current?.state === 'running'; current = this.saving) {
      await new Promise((resolve) => setTimeout(resolve, POLL_MS));
      const response = await this.api.get('/operations/{o}', { params: { path: { o: current.id } } });
      if (!this.take(response, (operation) => (this.saving = operation))) return;
    }
    if (this.saving?.error != null) this.problem = this.saving.error;
    if (this.saving?.state !== 'succeeded') return;
    this.measured = null;
  }

  async cancel(): Promise<void> {
    if (this.saving?.state !== 'running') return;
    const path = { o: this.saving.id };
    this.take(await this.command('Cancel saving', () => this.api.delete('/operations/{o}', { params: { path } })));
  }

  private command<T>(name: string, send: () => Promise<Outcome<T>>): Promise<Outcome<T>> {
    return this.gate.run({ name, vehicles: [] }, send);
  }

  /** Uses the value of an answer, or shows why there is none. */
  private take<T>(response: Outcome<T>, use: (value: T) => void = () => undefined): boolean {
    if (response.ok || response.problem.code !== DOUBLE_CLICK) this.problem = response.ok ? null : response.problem;
    if (response.ok) use(response.value);
    return response.ok;
  }
}

/** What leaves this computer when a source is chosen, in one sentence. */
export function whoLearns(source: MapSource | null): string {
  if (source === null) return 'No source is chosen, so nothing is asked for on the internet.';
  return `The server asks ${source.host} for the tiles that a map shows, and so tells it which area is viewed. Nothing else is sent.`;
}
