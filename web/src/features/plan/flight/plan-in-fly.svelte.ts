/**
 * The plan on the selected vehicle, for map and cards: the plan that the server uploaded, or that it reads from the vehicle
 * if it came from another ground station.
 */

import { ofVehicle, type ApiClient } from '../../../api/client';
import type { Problem } from '../../../api/problems';
import type { components } from '../../../api/schema';
import { page } from '../../../app/page.svelte';
import { commandGate } from '../../../app/vehicle-actions.svelte';
import type { CommandGate } from '../../../app/actions/command.svelte';
import { DOUBLE_CLICK } from '../../../app/actions/command.svelte';
import type { WireEvent } from '../../../live/wire';
import { simpleItems, type Plan } from '../document/document';

export type Mission = Readonly<components['schemas']['Mission']>;

/** What identifies the plan of a vehicle; null: the vehicle has no mission. */
export function planKey(vehicle: string, mission: Mission | null): string | null {
  if (mission === null || (mission.count ?? 0) === 0) return null;
  return [vehicle, mission.count, mission.mission_id, mission.fence_id, mission.rally_points_id].join(' ');
}

export class PlanInFly {
  private loaded = $state.raw<{ readonly key: string; readonly plan: Plan } | null>(null);
  private key = $state<string | null>(null);
  /** Why the plan could not be read. */
  private failure = $state.raw<{ readonly key: string; readonly problem: Problem } | null>(null);
  private vehicle: string | null = null;
  private count = 0;
  /** The key for which the page has let the server read the vehicle's plan. */
  private requestedKey: string | null = null;
  private isBusy = false;

  constructor(
    private readonly api: ApiClient,
    private readonly gate: CommandGate,
  ) {}

  /** The plan that the vehicle has; null: none, or not read yet. */
  readonly plan: Plan | null = $derived.by(() => (this.loaded !== null && this.loaded.key === this.key ? this.loaded.plan : null));
  readonly problem: Problem | null = $derived.by(() => (this.failure !== null && this.failure.key === this.key ? this.failure.problem : null));

  /** Shows the plan of this vehicle. @param mission as the vehicle reports it. */
  show(vehicle: string | null, mission: Mission | null): void {
    const key = vehicle === null ? null : planKey(vehicle, mission);
    if (key === this.key) return;
    [this.key, this.vehicle, this.count] = [key, vehicle, mission?.count ?? 0];
    void this.load(false);
  }

  /** Called every few seconds: the server reads a plan that it does not know, once. It waits until the ids no longer change, because another station may be uploading. */
  poll(): void {
    if (this.key !== null && this.plan === null) void this.load(true);
  }

  handleEvent(event: WireEvent): void {
    const operation = event.kind === 'operation' ? (event['operation'] as components['schemas']['Operation'] | undefined) : undefined;
    if (operation === undefined || operation.vehicle !== this.vehicle || !operation.kind.startsWith('mission/') || operation.state === 'running') return;
    if (operation.state === 'succeeded') void this.load(false);
    else if (operation.kind === 'mission/download' && this.key !== null && this.key === this.requestedKey)
      this.fail(this.key, { title: 'Not read', detail: operation.text, reasons: [], remedy: null, code: 'failed', status: 0, field: null });
  }

  /** Lets the server read the vehicle's plan. */
  async read(vehicle: string): Promise<void> {
    const { key } = this;
    this.requestedKey = key;
    this.failure = null;
    const command = { name: 'Read the plan', vehicles: [vehicle] };
    const response = await this.gate.run(command, () => this.api.post('/vehicles/{v}/mission/download', ofVehicle(vehicle)));
    if (!response.ok && key !== null && response.problem.code !== DOUBLE_CLICK) this.fail(key, response.problem);
  }

  private fail(key: string, problem: Problem): void {
    this.failure = { key, problem };
  }

  private async load(mayRead: boolean): Promise<void> {
    const { key, vehicle, count } = this;
    if (key === null || vehicle === null || this.isBusy) return;
    this.isBusy = true;
    try {
      const view = await this.api.get('/vehicles/{v}/mission', ofVehicle(vehicle));
      if (!view.ok || key !== this.key || view.value.transfer !== null) return;
      const response = view.value.holds.known_unix_s === null ? null : await this.api.get('/vehicles/{v}/mission/plan', ofVehicle(vehicle));
      if (key !== this.key) return;
      if (response?.ok === true && response.value.still_held !== false) {
        const plan = response.value.plan as Plan;
        if (response.value.still_held === true || simpleItems(plan).length === count) {
          this.loaded = { key, plan };
          return;
        }
      }
      if (mayRead && this.requestedKey !== key) await this.read(vehicle);
    } finally {
      this.isBusy = false;
      if (key !== this.key) void this.load(false);
    }
  }
}

export const planInFly = new PlanInFly(page.api, commandGate);
page.eventListeners.push((event) => planInFly.handleEvent(event));
