/** Which plan the selected vehicle holds, and the upload that is under way; both are the server's, and found again after a reload. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import type { WireEvent } from '../../live/wire';

type View = Readonly<components['schemas']['MissionView']>;
type Operation = Readonly<components['schemas']['Operation']>;

const UPLOAD = 'mission/upload';

export class VehicleMission {
  view = $state.raw<View | null>(null);
  /** The upload that runs or ended last. */
  upload = $state.raw<Operation | null>(null);
  problem = $state.raw<Problem | null>(null);
  private vehicle: string | null = null;

  constructor(private readonly api: ApiClient) {}

  readonly running: boolean = $derived.by(() => this.upload?.state === 'running');

  /** Another vehicle was selected. */
  show(vehicle: string | null): void {
    if (vehicle === this.vehicle) return;
    this.vehicle = vehicle;
    this.view = this.upload = this.problem = null;
    void this.ask();
  }

  async ask(): Promise<void> {
    const vehicle = this.vehicle;
    if (vehicle === null) return;
    const view = await this.api.get<View>(this.path(''));
    if (vehicle !== this.vehicle) return;
    this.view = view.ok ? view.value : null;
    if (this.view?.transfer == null || this.running) return;
    const all = await this.api.get<{ operations: readonly Operation[] }>(`/operations?vehicle=${encodeURIComponent(vehicle)}`);
    const found = all.ok ? all.value.operations.find((one) => one.kind === UPLOAD && one.state === 'running') : undefined;
    if (vehicle === this.vehicle && found !== undefined) this.upload = found;
  }

  /** Whether the vehicle holds just this version. */
  holds(id: string, version: number): boolean {
    const plan = this.view?.holds.state === 'plan' ? this.view.holds.plan : null;
    return plan?.id === id && plan.version === version;
  }

  async send(plan_id: string, version: number): Promise<void> {
    this.problem = null;
    const answer = await this.api.post<Operation>(this.path('/upload'), { plan_id, version });
    if (answer.ok) this.upload = this.upload?.id === answer.value.id ? this.upload : answer.value;
    else this.problem = answer.problem;
  }

  async cancel(): Promise<void> {
    if (this.upload === null) return;
    const answer = await this.api.delete(`/operations/${encodeURIComponent(this.upload.id)}`);
    if (!answer.ok) this.problem = answer.problem;
  }

  heard(event: WireEvent): void {
    const operation = event.kind === 'operation' ? (event['operation'] as Operation | undefined) : undefined;
    if (operation === undefined || operation.vehicle !== this.vehicle || !operation.kind.startsWith('mission/')) return;
    if (operation.kind === UPLOAD) this.upload = operation;
    if (operation.state !== 'running') void this.ask();
  }

  private path(what: string): string {
    return `/vehicles/${encodeURIComponent(this.vehicle ?? '')}/mission${what}`;
  }
}

/** What the vehicle holds, as a sentence. */
export function holdsText(
  name: string,
  mission: Pick<VehicleMission, 'view' | 'holds'>,
  current: { readonly id: string; readonly version: number } | null,
): string {
  const holds = mission.view?.holds;
  if (holds === undefined || holds.state === 'not_known') return `It is not known which plan ${name} holds.`;
  if (holds.state === 'another') return `${name} holds another plan than the one uploaded last.`;
  if (current !== null && mission.holds(current.id, current.version)) return `${name} holds this plan.`;
  const older =
    current !== null && holds.plan?.id === current.id
      ? `version ${holds.plan.version ?? 0} of this plan`
      : `the plan “${holds.plan?.name ?? 'without a name'}”`;
  return `${name} holds ${older}.`;
}
