/** The plan on the selected vehicle, and its upload or download. The server stores the plan and the transfer, so they survive a reload of the page. */

import { ofVehicle, type ApiClient, type Outcome } from '../../../api/client';
import type { Problem } from '../../../api/problems';
import { CommandGate, DOUBLE_CLICK, type FixedVehicles } from '../../../app/actions/command.svelte';
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
/** The server's code for an upload that a vehicle in Mission would fly at once. */
const FLIES_NEW_PLAN = 'flies_new_plan_at_once';

export class VehicleMission {
  /** The server's view of the plan on the vehicle; null: not known. */
  missionView = $state.raw<MissionView | null>(null);
  /** The latest upload or download, running or ended. */
  transfer = $state.raw<Operation | null>(null);
  private lastComparison = $state.raw<{ readonly plan: Plan; readonly result: Comparison } | null>(null);
  /** The plan to compare after the download has ended. */
  private pendingComparison: { readonly download: string; readonly plan: Plan; readonly reference: PlanReference } | null = null;
  /** Why the last request about the plan of a vehicle failed. */
  private lastProblem = $state.raw<{ readonly vehicle: string; readonly problem: Problem } | null>(null);
  private vehicle = $state<string | null>(null);
  /** The newest reported state of the vehicle; null: none since the vehicle was selected. */
  private reportedState: string | null = null;
  private requestCount = 0;

  constructor(
    private readonly api: ApiClient,
    private readonly gate = new CommandGate(),
    /** Shows why a request failed about a vehicle that is no longer shown. */
    private readonly showElsewhere: (commandName: string, vehicle: string, problem: Problem) => void = () => undefined,
  ) {}

  /** Why the last request about the shown vehicle failed; null: it did not fail. */
  readonly problem: Problem | null = $derived.by(() => (this.lastProblem?.vehicle === this.vehicle ? (this.lastProblem?.problem ?? null) : null));

  /** The last upload was refused, because the vehicle is in Mission and would fly the new plan at once. */
  readonly wouldFlyNewPlan: boolean = $derived.by(() => this.problem?.codes?.includes(FLIES_NEW_PLAN) === true);

  readonly running: boolean = $derived.by(() => this.transfer?.state === 'running');

  /** Selects the vehicle; for another vehicle, discards the state of the previous one. */
  selectVehicle(vehicle: string | null): void {
    if (vehicle === this.vehicle) return;
    this.vehicle = vehicle;
    this.missionView = this.transfer = this.lastComparison = this.pendingComparison = this.reportedState = null;
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

  /**
   * Uploads a saved version to the vehicle.
   * @param save saves the plan if necessary; null: it was not saved.
   * @param holdFirst a vehicle in Mission is switched to Hold before; if it does not hold, nothing is uploaded.
   */
  async upload(vehicle: string, save: () => Promise<{ readonly id: string; readonly version: number } | null>, holdFirst = false): Promise<void> {
    this.lastComparison = null;
    await this.startTransfer(holdFirst ? 'Hold and upload' : 'Upload', vehicle, async (fixed) => {
      const saved = await save();
      if (saved === null) return null;
      const problem = fixed.problem();
      if (problem !== null) return { ok: false, problem };
      return this.api.post('/vehicles/{v}/mission/upload', {
        ...ofVehicle(vehicle),
        body: { plan_id: saved.id, version: saved.version, ...(holdFirst ? { hold_first: true } : {}) },
      });
    });
  }

  /** Reads the vehicle's plan, and then compares this plan with `plan`. */
  async readBack(vehicle: string, plan: Plan, reference: PlanReference): Promise<void> {
    this.lastComparison = this.pendingComparison = null;
    const download = await this.startTransfer('Read back', vehicle, () => this.api.post('/vehicles/{v}/mission/download', ofVehicle(vehicle)));
    if (download === null) return;
    this.pendingComparison = { download, plan, reference };
    // The end event of a short download may arrive before the response.
    if (this.transfer?.id === download && this.transfer?.state === 'succeeded') await this.compare();
  }

  /** Result of the comparison with exactly this plan; null: not compared. */
  comparison(plan: Plan): Comparison | null {
    return this.lastComparison?.plan === plan ? this.lastComparison.result : null;
  }

  /** The plan that the server last read from the vehicle; null: the request failed, see `problem`, or another vehicle was selected meanwhile. */
  async downloadedPlan(vehicle: string): Promise<DownloadedPlan | null> {
    const response = await this.api.get('/vehicles/{v}/mission/plan', ofVehicle(vehicle));
    this.setProblem('Open the vehicle’s plan', vehicle, response);
    return response.ok && vehicle === this.vehicle ? (response.value as DownloadedPlan) : null;
  }

  async cancel(): Promise<void> {
    const { transfer, vehicle } = this;
    if (transfer === null || vehicle === null) return;
    const command = { name: 'Cancel the transfer', vehicles: [vehicle] };
    this.setProblem(command.name, vehicle, await this.gate.run(command, () => this.api.delete('/operations/{o}', { params: { path: { o: transfer.id } } })));
  }

  private setProblem(commandName: string, vehicle: string, outcome: Outcome<unknown>): void {
    if (outcome.ok) this.lastProblem = null;
    else if (outcome.problem.code !== DOUBLE_CLICK) {
      this.lastProblem = { vehicle, problem: outcome.problem };
      if (vehicle !== this.vehicle) this.showElsewhere(commandName, vehicle, outcome.problem);
    }
  }

  handleEvent(event: WireEvent): void {
    const operation = event.kind === 'operation' ? (event['operation'] as Operation | undefined) : undefined;
    if (operation === undefined || operation.vehicle !== this.vehicle || !operation.kind.startsWith('mission/')) return;
    if (TRANSFER_KINDS.includes(operation.kind)) this.transfer = operation;
    if (operation.state === 'running') return;
    if (operation.state === 'succeeded' && operation.id === this.pendingComparison?.download) void this.compare();
    else void this.refresh();
  }

  /**
   * Starts a transfer of a vehicle's plan.
   * @param send null: the transfer was not requested.
   * @returns the operation's id; null: the transfer was refused, or another vehicle was selected meanwhile.
   */
  private async startTransfer(name: string, vehicle: string, send: (fixed: FixedVehicles) => Promise<Outcome<Operation> | null>): Promise<string | null> {
    const response = await this.gate.run<Operation | null>({ name, vehicles: [vehicle] }, async (fixed) => (await send(fixed)) ?? { ok: true, value: null });
    this.setProblem(name, vehicle, response);
    if (!response.ok || response.value === null || vehicle !== this.vehicle) return null;
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
    this.setProblem('Compare', vehicle ?? '', response);
    if (response.ok) this.lastComparison = { plan: pending.plan, result: response.value };
    await this.refresh();
  }
}
