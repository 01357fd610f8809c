/**
 * The plan on the selected vehicle, and its upload or download. Both states come from the server, so a reload keeps
 * them.
 */

import { ofVehicle, type ApiClient, type Outcome } from '../../../api/client';
import type { Problem } from '../../../api/problems';
import type { components } from '../../../api/schema';
import type { WireEvent } from '../../../live/wire';
import type { Plan } from '../document/document';
import { isOnVehicle, type Comparison } from './vehicle-plan';

type View = Readonly<components['schemas']['MissionView']>;
type Operation = Readonly<components['schemas']['Operation']>;
export type Downloaded = Readonly<Omit<components['schemas']['DownloadedPlan'], 'plan'>> & { readonly plan: Plan };
/** A saved version, or a plan without one. */
type PlanReference = Readonly<components['schemas']['WhichPlan']>;

const TRANSFERS = ['mission/upload', 'mission/download'];

export class VehicleMission {
  view = $state.raw<View | null>(null);
  /** The latest upload or download, running or ended. */
  transfer = $state.raw<Operation | null>(null);
  private compared = $state.raw<{ readonly to: Plan; readonly found: Comparison } | null>(null);
  /** The plan to compare after the download has ended. */
  private pendingComparison: { readonly download: string; readonly to: Plan; readonly which: PlanReference } | null = null;
  problem = $state.raw<Problem | null>(null);
  private vehicle: string | null = null;
  /** The vehicle's state at the newest request; null: none since the vehicle was selected. */
  private reported: string | null = null;
  private requests = 0;

  constructor(private readonly api: ApiClient) {}

  readonly running: boolean = $derived.by(() => this.transfer?.state === 'running');

  /** Called when another vehicle is selected. */
  selectVehicle(vehicle: string | null): void {
    if (vehicle === this.vehicle) return;
    this.vehicle = vehicle;
    this.view = this.transfer = this.problem = this.compared = this.pendingComparison = this.reported = null;
    void this.refresh();
  }

  /** Requests the server's view again if the vehicle reports another state. @param reported see `reportedState`. */
  onReported(reported: string): void {
    const changed = this.reported !== null && this.reported !== reported;
    this.reported = reported;
    if (changed) void this.refresh();
  }

  /** An answer to an earlier request than the newest one is discarded. */
  async refresh(): Promise<void> {
    const vehicle = this.vehicle;
    if (vehicle === null) return;
    this.requests += 1;
    const number = this.requests;
    const view = await this.api.get('/vehicles/{v}/mission', ofVehicle(vehicle));
    if (vehicle !== this.vehicle || number !== this.requests) return;
    this.view = view.ok ? view.value : null;
    if (this.view?.transfer == null || this.running) return;
    const all = await this.api.get('/operations', { params: { query: { vehicle } } });
    const found = all.ok ? all.value.operations.find((one) => TRANSFERS.includes(one.kind) && one.state === 'running') : undefined;
    if (vehicle === this.vehicle && found !== undefined) this.transfer = found;
  }

  /** Whether exactly this version is on the vehicle. */
  hasVersion(id: string, version: number): boolean {
    return isOnVehicle(this.view?.holds, { id, version });
  }

  async send(plan_id: string, version: number): Promise<void> {
    this.compared = null;
    await this.begin((of) => this.api.post('/vehicles/{v}/mission/upload', { ...of, body: { plan_id, version } }));
  }

  /** Reads the vehicle's plan, then compares it with this one. */
  async readBack(to: Plan, which: PlanReference): Promise<void> {
    this.compared = this.pendingComparison = null;
    const download = await this.begin((of) => this.api.post('/vehicles/{v}/mission/download', of));
    if (download !== null) this.pendingComparison = { download, to, which };
    // A short download may have ended before the answer came.
    if (this.transfer?.id === download && this.transfer?.state === 'succeeded') await this.compare();
  }

  /** Result of the comparison with exactly this plan. */
  comparison(plan: Plan): Comparison | null {
    return this.compared?.to === plan ? this.compared.found : null;
  }

  /** The plan that was last read from the vehicle; null: see `problem`. */
  async downloadedPlan(): Promise<Downloaded | null> {
    const answer = await this.api.get('/vehicles/{v}/mission/plan', ofVehicle(this.vehicle ?? ''));
    this.problem = answer.ok ? null : answer.problem;
    return answer.ok ? (answer.value as Downloaded) : null;
  }

  async cancel(): Promise<void> {
    if (this.transfer === null) return;
    const answer = await this.api.delete('/operations/{o}', { params: { path: { o: this.transfer.id } } });
    if (!answer.ok) this.problem = answer.problem;
  }

  onEvent(event: WireEvent): void {
    const operation = event.kind === 'operation' ? (event['operation'] as Operation | undefined) : undefined;
    if (operation === undefined || operation.vehicle !== this.vehicle || !operation.kind.startsWith('mission/')) return;
    if (TRANSFERS.includes(operation.kind)) this.transfer = operation;
    if (operation.state === 'running') return;
    if (operation.state === 'succeeded' && operation.id === this.pendingComparison?.download) void this.compare();
    else void this.refresh();
  }

  /** @returns the operation's id; null: the server refused it. */
  private async begin(send: (of: ReturnType<typeof ofVehicle>) => Promise<Outcome<Operation>>): Promise<string | null> {
    this.problem = null;
    const answer = await send(ofVehicle(this.vehicle ?? ''));
    if (!answer.ok) {
      this.problem = answer.problem;
      return null;
    }
    // Its end event may have come before the answer.
    if (this.transfer?.id !== answer.value.id) this.transfer = answer.value;
    return answer.value.id;
  }

  private async compare(): Promise<void> {
    const [wanted, vehicle] = [this.pendingComparison, this.vehicle];
    if (wanted === null) return;
    this.pendingComparison = null;
    const found = await this.api.post('/vehicles/{v}/mission/compare', { ...ofVehicle(vehicle ?? ''), body: wanted.which });
    if (vehicle !== this.vehicle) return;
    if (found.ok) this.compared = { to: wanted.to, found: found.value };
    else this.problem = found.problem;
    await this.refresh();
  }
}
