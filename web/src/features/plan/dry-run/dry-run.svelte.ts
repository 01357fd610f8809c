/** Starts a dry run of a plan, follows its progress, and stores the time that map and 3D view show. */

import type { ApiClient } from '../../../api/client';
import type { Problem } from '../../../api/problems';
import type { components } from '../../../api/schema';
import type { WireEvent } from '../../../live/wire';
import { toApi } from '../api';
import { toDryRunRequest, type Conditions } from './conditions';
import type { Document } from '../document-kinds';

type Schemas = components['schemas'];
type Operation = Readonly<Schemas['Operation']>;
export type DryRunResult = Readonly<Schemas['DryRunView']>;

/** One vehicle, or for a mission with roles the vehicle of each role; null: no vehicle. */
export type DryRunVehicles = { vehicle: string | null } | { vehicles: Readonly<Record<string, string>> | null };

export class DryRun {
  operation = $state.raw<Operation | null>(null);
  problem = $state.raw<Problem | null>(null);
  private result = $state.raw<DryRunResult | null>(null);
  /** The document that `result` belongs to. */
  private simulatedDocument = $state.raw<Document | null>(null);
  private requestedDocument: Document | null = null;
  /** Events of operations that arrive before the response to the start: one of them may be about this dry run. */
  private earlyEvents: WireEvent[] | null = null;
  /** The time that map and 3D view show [s]. */
  t_s = $state(0);
  playing = $state(false);

  constructor(private readonly api: ApiClient) {}

  readonly running: boolean = $derived.by(() => this.operation?.state === 'running');

  /** Result of the dry run of exactly this document; null: there is no result. */
  resultOf(document: Document): DryRunResult | null {
    return this.simulatedDocument === document ? this.result : null;
  }

  /**
   * Starts a dry run. With a vehicle, the dry run uses the vehicle's parameters, position and battery charge. Without a
   * vehicle, the dry run begins at the planned start position. A mission with roles has a vehicle for each role, or none.
   */
  async start(document: Document, vehicles: DryRunVehicles, conditions: Conditions): Promise<void> {
    if (this.earlyEvents !== null || this.running) return; // one dry run at a time: the first one is still starting or running
    this.problem = null;
    this.requestedDocument = document;
    this.earlyEvents = [];
    const response = await this.api.post('/dry_runs', { body: { plan: toApi(document), ...vehicles, ...toDryRunRequest(conditions) } });
    const earlyEvents = this.earlyEvents;
    this.earlyEvents = null;
    if (!response.ok) this.problem = response.problem;
    else if (this.operation?.id !== response.value.id) this.operation = response.value;
    for (const event of earlyEvents) await this.handleEvent(event);
  }

  /** Shows this time and stops playing. */
  showTime(t_s: number): void {
    this.playing = false;
    this.t_s = t_s;
  }

  async cancel(): Promise<void> {
    if (this.operation === null) return;
    const response = await this.api.delete('/operations/{o}', { params: { path: { o: this.operation.id } } });
    if (!response.ok) this.problem = response.problem;
  }

  /** Handles the progress event of the operation that this page started. */
  async handleEvent(event: WireEvent): Promise<void> {
    const operation = event.kind === 'operation' ? (event['operation'] as Operation | undefined) : undefined;
    const document = this.requestedDocument;
    if (operation !== undefined) this.earlyEvents?.push(event);
    if (operation === undefined || document === null || operation.id !== this.operation?.id) return;
    this.operation = operation;
    const id = operation.result?.['dry_run'];
    if (operation.state !== 'succeeded' || typeof id !== 'string') return;
    const response = await this.api.get('/dry_runs/{d}', { params: { path: { d: id } } });
    if (this.operation?.id !== operation.id) return; // another dry run was started meanwhile
    if (!response.ok) {
      this.problem = response.problem;
      return;
    }
    this.result = response.value;
    this.simulatedDocument = document;
    this.showTime(0);
  }
}
