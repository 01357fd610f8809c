/** The plan on the selected vehicle, and its upload or download. The server stores the plan and the transfer, so they survive a reload of the page. */

import { ofVehicle, type ApiClient, type Outcome } from '../../../api/client';
import type { Problem } from '../../../api/problems';
import type { components } from '../../../api/schema';
import type { WireEvent } from '../../../live/wire';
import type { Plan } from '../document/document';
import { isOnVehicle, type Comparison } from './vehicle-plan';

type MissionView = Readonly<components['schemas']['MissionView']>;
type Operation = Readonly<components['schemas']['Operation']>;
export type DownloadedPlan = Readonly<Omit<components['schemas']['DownloadedPlan'], 'plan'>> & { readonly plan: Plan };
/** A saved version, or the content of an unsaved plan. */
type PlanReference = Readonly<components['schemas']['WhichPlan']>;

const TRANSFER_KINDS = ['mission/upload', 'mission/download'];

export class VehicleMission {
  /** The server's view of the plan on the vehicle; null: not known. */
  missionView = $state.raw<MissionView | null>(null);
  /** The latest upload or download, running or ended. */
  transfer = $state.raw<Operation | null>(null);
  private lastComparison = $state.raw<{ readonly plan: Plan; readonly result: Comparison } | null>(null);
  /** The plan to compare after the download has ended. */
  private pendingComparison: { readonly download: string; readonly plan: Plan; readonly reference: PlanReference } | null = null;
  problem = $state.raw<Problem | null>(null);
  private vehicle: string | null = null;
  /** The newest reported state of the vehicle; null: none since the vehicle was selected. */
  private reportedState: string | null = null;
  private requestCount = 0;

  constructor(private readonly api: ApiClient) {}

  readonly running: boolean = $derived.by(() => this.transfer?.state === 'running');

  /** Selects the vehicle; for another vehicle, discards the state of the previous one. */
  selectVehicle(vehicle: string | null): void {
    if (vehicle === this.vehicle) return;
    this.vehicle = vehicle;
    this.missionView = this.transfer = this.problem = this.lastComparison = this.pendingComparison = this.reportedState = null;
    void this.refresh();
  }

  /**
   * Requests the server's view again after a change of the reported state.
   * @param newState result of `reportedState`.
   */
  onReportedState(newState: string): void {
    const hasChanged = this.reportedState !== null && this.reportedState !== newState;
    this.reportedState = newState;
    if (hasChanged) void this.refresh();
  }

  /** Requests the server's view. Only the response to the newest request is used. */
  async refresh(): Promise<void> {
    const vehicle = this.vehicle;
    if (vehicle === null) return;
    this.requestCount += 1;
    const requestNumber = this.requestCount;
    const response = await this.api.get('/vehicles/{v}/mission', ofVehicle(vehicle));
    if (vehicle !== this.vehicle || requestNumber !== this.requestCount) return;
    this.missionView = response.ok ? response.value : null;
    if (this.missionView?.transfer == null || this.running) return;
    const operations = await this.api.get('/operations', { params: { query: { vehicle } } });
    const runningTransfer = operations.ok
      ? operations.value.operations.find(({ kind, state }) => TRANSFER_KINDS.includes(kind) && state === 'running')
      : undefined;
    if (vehicle === this.vehicle && runningTransfer !== undefined) this.transfer = runningTransfer;
  }

  /** Whether exactly this version is on the vehicle. */
  hasVersion(id: string, version: number): boolean {
    return isOnVehicle(this.missionView?.holds, { id, version });
  }

  async upload(plan_id: string, version: number): Promise<void> {
    this.lastComparison = null;
    await this.startTransfer((target) => this.api.post('/vehicles/{v}/mission/upload', { ...target, body: { plan_id, version } }));
  }

  /** Reads the vehicle's plan, and then compares this plan with `plan`. */
  async readBack(plan: Plan, reference: PlanReference): Promise<void> {
    this.lastComparison = this.pendingComparison = null;
    const download = await this.startTransfer((target) => this.api.post('/vehicles/{v}/mission/download', target));
    if (download !== null) this.pendingComparison = { download, plan, reference };
    // The end event of a short download may arrive before the response.
    if (this.transfer?.id === download && this.transfer?.state === 'succeeded') await this.compare();
  }

  /** Result of the comparison with exactly this plan; null: not compared. */
  comparison(plan: Plan): Comparison | null {
    return this.lastComparison?.plan === plan ? this.lastComparison.result : null;
  }

  /** The plan that the server last read from the vehicle; null: the request failed, see `problem`. */
  async downloadedPlan(): Promise<DownloadedPlan | null> {
    const response = await this.api.get('/vehicles/{v}/mission/plan', ofVehicle(this.vehicle ?? ''));
    this.problem = response.ok ? null : response.problem;
    return response.ok ? (response.value as DownloadedPlan) : null;
  }

  async cancel(): Promise<void> {
    if (this.transfer === null) return;
    const response = await this.api.delete('/operations/{o}', { params: { path: { o: this.transfer.id } } });
    if (!response.ok) this.problem = response.problem;
  }

  handleEvent(event: WireEvent): void {
    const operation = event.kind === 'operation' ? (event['operation'] as Operation | undefined) : undefined;
    if (operation === undefined || operation.vehicle !== this.vehicle || !operation.kind.startsWith('mission/')) return;
    if (TRANSFER_KINDS.includes(operation.kind)) this.transfer = operation;
    if (operation.state === 'running') return;
    if (operation.state === 'succeeded' && operation.id === this.pendingComparison?.download) void this.compare();
    else void this.refresh();
  }

  /** Starts a transfer. @returns the operation's id; null: the server refused the transfer. */
  private async startTransfer(send: (target: ReturnType<typeof ofVehicle>) => Promise<Outcome<Operation>>): Promise<string | null> {
    this.problem = null;
    const response = await send(ofVehicle(this.vehicle ?? ''));
    if (!response.ok) {
      this.problem = response.problem;
      return null;
    }
    // The end event of the operation may arrive before the response.
    if (this.transfer?.id !== response.value.id) this.transfer = response.value;
    return response.value.id;
  }

  private async compare(): Promise<void> {
    const [pending, vehicle] = [this.pendingComparison, this.vehicle];
    if (pending === null) return;
    this.pendingComparison = null;
    const response = await this.api.post('/vehicles/{v}/mission/compare', { ...ofVehicle(vehicle ?? ''), body: pending.reference });
    if (vehicle !== this.vehicle) return;
    if (response.ok) this.lastComparison = { plan: pending.plan, result: response.value };
    else this.problem = response.problem;
    await this.refresh();
  }
}
