/** A plan flown in simulation before it is flown: asked for, followed, looked at moment by moment. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import type { WireEvent } from '../../live/wire';
import type { Document } from './kinds';

type Schemas = components['schemas'];
type Operation = Readonly<Schemas['Operation']>;
export type DryRunView = Readonly<Schemas['DryRunView']>;

export interface Weather {
  readonly wind_m_s: number;
  /** Where it comes from, clockwise from north. */
  readonly from_deg: number;
  /** 0: once, in just this wind. */
  readonly flights: number;
}

export class DryRun {
  weather = $state.raw<Weather>({ wind_m_s: 0, from_deg: 0, flights: 0 });
  operation = $state.raw<Operation | null>(null);
  problem = $state.raw<Problem | null>(null);
  private view = $state.raw<DryRunView | null>(null);
  /** What `view` is of. */
  private flown = $state.raw<Document | null>(null);
  private asked: Document | null = null;
  /** The moment that is looked at [s]. */
  t_s = $state(0);

  constructor(private readonly api: ApiClient) {}

  readonly running: boolean = $derived.by(() => this.operation?.state === 'running');

  /** What came of this very document; null: it has not been flown as it is now. */
  of(document: Document): DryRunView | null {
    return this.flown === document ? this.view : null;
  }

  async start(document: Document, vehicle: string | null): Promise<void> {
    this.problem = null;
    this.asked = document;
    const { flights } = this.weather;
    const body = { plan: document, vehicle, conditions: { wind_ned_m_s: windOf(this.weather) }, flights: flights === 0 ? null : flights };
    const answer = await this.api.post<Operation>('/dry_runs', body);
    if (!answer.ok) this.problem = answer.problem;
    else if (this.operation?.id !== answer.value.id) this.operation = answer.value;
  }

  async cancel(): Promise<void> {
    if (this.operation === null) return;
    const answer = await this.api.delete(`/operations/${encodeURIComponent(this.operation.id)}`);
    if (!answer.ok) this.problem = answer.problem;
  }

  /** The operation that was started here says how far it is. */
  async heard(event: WireEvent): Promise<void> {
    const operation = event.kind === 'operation' ? (event['operation'] as Operation | undefined) : undefined;
    const document = this.asked;
    if (operation === undefined || document === null || operation.id !== this.operation?.id) return;
    this.operation = operation;
    const id = operation.result?.['dry_run'];
    if (operation.state !== 'succeeded' || typeof id !== 'string') return;
    const answer = await this.api.get<DryRunView>(`/dry_runs/${encodeURIComponent(id)}`);
    if (!answer.ok) {
      this.problem = answer.problem;
      return;
    }
    this.view = answer.value;
    this.flown = document;
    this.t_s = 0;
  }
}

/** Where the air moves to, north, east, down [m/s]. */
export function windOf({ wind_m_s, from_deg }: Weather): [number, number, number] {
  const from_rad = (from_deg * Math.PI) / 180;
  return [-wind_m_s * Math.cos(from_rad) + 0, -wind_m_s * Math.sin(from_rad) + 0, 0];
}
