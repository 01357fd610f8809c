/** Sources of tiles on the server: choosing one, adding own ones, and saving what the map shows for the field. */

import type { ApiClient, Outcome } from '../../api/client';
import type { Problem } from '../../api/problems';
import { CommandGate, DOUBLE_CLICK } from '../../app/actions/command.svelte';
import type { MapSource, Operation, SourceCalls, SourceList, WmtsLayers } from './source-calls';

const POLL_MS = 400;

interface NewSource {
  name: string;
  url: string;
  attribution: string;
  may_save: boolean;
  min_zoom?: number;
  max_zoom?: number;
}

/** Whether an address is that of a WMTS service's capabilities, and not of tiles. */
export function isWmtsDescription(url: string): boolean {
  const [path = '', query = ''] = url.trim().split('?');
  if (/\{|request=gettile/i.test(url)) return false;
  return /\.xml$/i.test(path) || /request=getcapabilities|service=wmts/i.test(query) || /\/wmts\/?$/i.test(path);
}

/** @typeParam Region the area that is saved, with its name. */
export class TileSources<Region extends { name: string }> {
  private list = $state.raw<SourceList | null>(null);
  problem = $state.raw<Pick<Problem, 'title' | 'detail'> | null>(null);
  /** The region whose size was asked for, which is then saved; null: none. */
  measured = $state.raw<{ region: Region; tiles: number; estimated_bytes: number } | null>(null);
  /** The layers of the WMTS service at an address that somebody typed; null: none were read. */
  service = $state.raw<({ url: string } & WmtsLayers) | null>(null);
  /** The saving of a region that this page has started. */
  saving = $state.raw<Operation | null>(null);

  constructor(
    private readonly api: ApiClient,
    private readonly calls: SourceCalls<Region>,
    /** Map or ground: part of the names of commands. */
    private readonly what: 'map' | 'ground',
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
    this.take(await this.calls.list(), (list) => (this.list = list));
  }

  async choose(source: string | null): Promise<void> {
    this.measured = null;
    const response = await this.command('Choose a source', () => this.calls.choose(source));
    this.take(response, (list) => (this.list = list));
  }

  /** Whether this is the address of a service whose layers have to be read first. */
  isService(url: string): boolean {
    return this.calls.layers !== undefined && isWmtsDescription(url) && this.service?.url !== url.trim();
  }

  /** Asks the service at an address for its layers. */
  async readLayers(url: string): Promise<void> {
    const { layers } = this.calls;
    this.service = null;
    if (layers === undefined) return;
    const response = await this.command('Read a service', () => layers(url.trim()));
    this.take(response, (found) => (this.service = { url: url.trim(), ...found }));
  }

  /** Adds a source and chooses it. Returns whether the server accepted it. @param source without zooms: the usual ones */
  async add(source: NewSource): Promise<boolean> {
    let id: string | null = null;
    const body = { max_zoom: this.what === 'map' ? 19 : 15, min_zoom: 0, ...source };
    this.take(await this.command('Add a source', () => this.calls.add(body)), (added) => (id = added.id));
    if (id === null) return false;
    await this.choose(id);
    return true;
  }

  async remove(source: MapSource): Promise<void> {
    if (!this.take(await this.command('Remove a source', () => this.calls.remove(source.id)))) return;
    await this.read();
  }

  /** Asks how large a region is. @param region null: the map is not large, so nobody sees what would be saved. */
  async measure(region: Region | null): Promise<void> {
    this.measured = null;
    this.saving = null;
    if (region === null) this.problem = { title: 'The map is small', detail: 'Make it large (M) and show the area that you want to save.' };
    else this.take(await this.calls.size(region), (size) => (this.measured = { region, ...size }));
  }

  /** Saves the measured region, and follows the saving to its end. */
  async save(name: string): Promise<void> {
    const { measured } = this;
    if (measured === null || this.saving?.state === 'running') return;
    const region = { ...measured.region, name };
    const started = await this.command('Save an area', () => this.calls.save(region));
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
    return this.gate.run({ name: `${name} (${this.what})`, vehicles: [] }, send);
  }

  /** Uses the value of an answer, or shows why there is none. */
  private take<T>(response: Outcome<T>, use: (value: T) => void = () => undefined): boolean {
    if (response.ok || response.problem.code !== DOUBLE_CLICK) this.problem = response.ok ? null : response.problem;
    if (response.ok) use(response.value);
    return response.ok;
  }
}

/** What leaves this computer when a source of the map is chosen, in one sentence. */
export function whoLearns(source: MapSource | null): string {
  if (source === null) return 'No source is chosen, so nothing is asked for on the internet.';
  return `The server asks ${source.host} for the tiles that a map shows, and so tells it which area is viewed. Nothing else is sent.`;
}

/** The same for a source of heights. */
export function whoLearnsOfGround(source: MapSource | null): string {
  if (source === null) return 'No source is chosen, so nothing is asked for on the internet. Elevation files on the server are used as before.';
  return `When you save an area, the server asks ${source.host} for its tiles, and so tells it which area that is. Nothing else is sent, and nothing before.`;
}
