/** The files on a vehicle: one folder at a time; downloads, writes and removals of a file. */

import { ofVehicle, type ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import { CommandGate, DOUBLE_CLICK } from '../../app/actions/command.svelte';
import { follow, type Operation } from '../../app/follow';
import { sizeText } from '../../ui/format';

export type Folder = components['schemas']['VehicleFolder'];
export type Entry = components['schemas']['VehicleFileEntry'];
export type Danger = Entry['danger'];

/** What would happen, frozen when a person pressed the button, until it is confirmed. */
export interface Draft {
  readonly vehicle: string;
  readonly kind: 'put' | 'remove';
  readonly path: string;
  /** The file is there already; a folder is removed. */
  readonly existing: Entry | null;
  readonly danger: Danger;
  /** Of a file that is written. */
  readonly content_base64: string;
  readonly size_bytes: number;
}

/** The server writes no larger ones. */
export const MAX_WRITTEN_BYTES = 700_000;

/** What hangs on a file, said before it is changed. */
export const DANGERS: Readonly<Record<NonNullable<Danger>, string>> = {
  startup: 'PX4 runs or reads this as it starts: a mistake may keep it from starting, or change how it flies.',
  parameters: 'It holds the vehicle’s parameters with calibration and tuning: without them it may not fly safely after its next start.',
  missions: 'It holds mission, geofence and rally points: they may be lost at the next start.',
  log: 'It is a recorded flight: what is not downloaded is lost.',
  firmware: 'It is flashed onto other devices at the next start: a wrong one may make them fail.',
  device: 'It is no file but a device.',
};

export function parentOf(path: string): string {
  return path.slice(0, Math.max(0, path.lastIndexOf('/'))) || '/';
}

export function inFolder(folder: string, name: string): string {
  return `${folder === '' || folder === '/' ? '' : folder}/${name}`;
}

export function toBase64(bytes: Uint8Array): string {
  let text = '';
  for (let i = 0; i < bytes.length; i += 0x8000) text += String.fromCharCode(...bytes.subarray(i, i + 0x8000));
  return btoa(text);
}

type Shown = Pick<Problem, 'title' | 'detail'>;

export class VehicleFiles {
  private list = $state.raw<{ readonly vehicle: string; readonly folder: Folder } | null>(null);
  private lastProblem = $state.raw<{ readonly vehicle: string; readonly problem: Shown } | null>(null);
  /** Id of the vehicle whose folder is being read. */
  reading = $state<string | null>(null);
  /** The newest download or write that this page has started. */
  operation = $state.raw<Operation | null>(null);
  toConfirm = $state.raw<Draft | null>(null);
  /** What was done last on this vehicle, as a person reads it. */
  private done = $state.raw<{ readonly vehicle: string; readonly text: string } | null>(null);

  constructor(
    private readonly gate = new CommandGate(),
    /** Saves a downloaded file in the browser; replaced in tests. */
    private readonly save = saveUrl,
  ) {}

  folderOf(vehicle: string): Folder | null {
    return this.list?.vehicle === vehicle ? this.list.folder : null;
  }

  problemOf(vehicle: string): Shown | null {
    return this.lastProblem?.vehicle === vehicle ? this.lastProblem.problem : null;
  }

  doneOf(vehicle: string): string | null {
    return this.done?.vehicle === vehicle ? this.done.text : null;
  }

  /** The running download or write of this vehicle. */
  operationOf(vehicle: string): Operation | null {
    return this.operation?.state === 'running' && this.operation.vehicle === vehicle ? this.operation : null;
  }

  async read(api: ApiClient, vehicle: string, path: string): Promise<void> {
    this.begin();
    this.reading = vehicle;
    const response = await api.post('/vehicles/{v}/files/list', { ...ofVehicle(vehicle), body: { path } });
    if (this.reading !== vehicle) return;
    this.reading = null;
    if (response.ok) this.list = { vehicle, folder: response.value };
    else this.lastProblem = { vehicle, problem: response.problem };
  }

  /** Downloads a file to the server, then saves it in the browser. */
  async get(api: ApiClient, vehicle: string, path: string): Promise<void> {
    this.begin();
    const outcome = await this.gate.run({ name: 'Get a file', vehicles: [vehicle], part: path }, () =>
      api.post('/vehicles/{v}/files/get', { ...ofVehicle(vehicle), body: { path } }),
    );
    if (!this.took(vehicle, outcome)) return;
    const ended = await this.follow(api, vehicle, outcome.value);
    if (ended.state !== 'succeeded') return;
    const { file, name, verified } = ended.result as { file: string; name: string; verified: string };
    this.save(`/api/v1/vehicles/${encodeURIComponent(vehicle)}/files/${file}`, name);
    this.done = { vehicle, text: verified === 'crc32' ? `${path} was received; its checksum is right.` : `${path} was received.` };
  }

  /** Asks for confirmation to write a file into the shown folder. */
  async askToPut(vehicle: string, file: File): Promise<void> {
    const folder = this.folderOf(vehicle);
    this.begin();
    if (folder === null) return;
    if (file.size > MAX_WRITTEN_BYTES) {
      const detail = `${file.name} has ${sizeText(file.size)}; at most ${sizeText(MAX_WRITTEN_BYTES)} are written over the link.`;
      this.lastProblem = { vehicle, problem: { title: 'Not written', detail } };
      return;
    }
    const content_base64 = toBase64(new Uint8Array(await file.arrayBuffer()));
    const path = inFolder(folder.path, file.name);
    const existing = folder.entries.find(({ name }) => name === file.name) ?? null;
    const danger = existing?.danger ?? (folder.danger === 'log' ? null : folder.danger);
    this.toConfirm = { vehicle, kind: 'put', path, existing, danger, content_base64, size_bytes: file.size };
  }

  askToRemove(vehicle: string, entry: Entry): void {
    this.begin();
    this.toConfirm = { vehicle, kind: 'remove', path: entry.path, existing: entry, danger: entry.danger, content_base64: '', size_bytes: 0 };
  }

  /** Does what a person has confirmed. */
  async confirm(api: ApiClient, draft: Draft): Promise<void> {
    this.begin();
    const { vehicle, path, content_base64 } = draft;
    if (draft.kind === 'remove') {
      const outcome = await this.gate.run({ name: 'Remove a file', vehicles: [vehicle], part: path }, () =>
        api.post('/vehicles/{v}/files/remove', { ...ofVehicle(vehicle), body: { path, confirm: `${path} is removed from vehicle ${vehicle}` } }),
      );
      if (this.took(vehicle, outcome)) await this.readAgain(api, vehicle, `${path} was removed.`);
      return;
    }
    const outcome = await this.gate.run({ name: 'Write a file', vehicles: [vehicle], part: path }, () =>
      api.post('/vehicles/{v}/files/put', {
        ...ofVehicle(vehicle),
        body: { path, content_base64, confirm: `${path} is written on vehicle ${vehicle}` },
      }),
    );
    if (!this.took(vehicle, outcome)) return;
    const ended = await this.follow(api, vehicle, outcome.value);
    if (ended.state === 'succeeded') await this.readAgain(api, vehicle, `${path} was written; its checksum is right.`);
  }

  async makeFolder(api: ApiClient, vehicle: string, path: string): Promise<void> {
    this.begin();
    const outcome = await this.gate.run({ name: 'Make a folder', vehicles: [vehicle], part: path }, () =>
      api.post('/vehicles/{v}/files/make_folder', { ...ofVehicle(vehicle), body: { path } }),
    );
    if (this.took(vehicle, outcome)) await this.readAgain(api, vehicle, `${path} was made.`);
  }

  /** Cancels the running download, of which the next one continues, or the running write, which leaves the old file. */
  async cancel(api: ApiClient): Promise<void> {
    const { operation } = this;
    if (operation?.vehicle == null) return;
    const outcome = await this.gate.run({ name: 'Cancel the transfer', vehicles: [operation.vehicle] }, () =>
      api.delete('/operations/{o}', { params: { path: { o: operation.id } } }),
    );
    this.took(operation.vehicle, outcome);
  }

  private begin(): void {
    this.toConfirm = null;
    this.lastProblem = null;
    this.done = null;
  }

  private took<T>(vehicle: string, outcome: { ok: true; value: T } | { ok: false; problem: Problem }): outcome is { ok: true; value: T } {
    if (!outcome.ok && outcome.problem.code !== DOUBLE_CLICK) this.lastProblem = { vehicle, problem: outcome.problem };
    return outcome.ok;
  }

  private async follow(api: ApiClient, vehicle: string, begun: Operation): Promise<Operation> {
    this.operation = begun;
    const ended = await follow(api, begun, (operation) => {
      if (this.operation?.id !== operation.id) return false;
      this.operation = operation;
      return true;
    });
    if (ended.error !== null) this.lastProblem = { vehicle, problem: ended.error };
    return ended;
  }

  private async readAgain(api: ApiClient, vehicle: string, done: string): Promise<void> {
    const folder = this.folderOf(vehicle);
    if (folder !== null) await this.read(api, vehicle, folder.path || '/');
    this.done = { vehicle, text: done };
  }
}

function saveUrl(url: string, name: string): void {
  const link = document.createElement('a');
  link.href = url;
  link.download = name;
  link.click();
}
