/** Takes, requests, gives and releases control of the selected vehicle. */

import type { VehicleFacts } from '../../vehicle/facts';
import type { ApiClient } from '../../api/client';
import type { WireEvent } from '../../live/wire';
import type { ActionController } from '../../app/actions/controller.svelte';
import { toAnswer, type ControlRequest } from '../../vehicle/control';

const REASON_MAX = 200;

export class ControlDesk {
  open = $state(false);
  reason = $state('');
  /** Vehicles whose holder denied this page's request. */
  private readonly denials = $state<Record<string, boolean>>({});

  constructor(
    private readonly api: ApiClient,
    private readonly actions: ActionController,
  ) {}

  toggle(): boolean {
    this.open = !this.open;
    return true;
  }

  denied(id: string): boolean {
    return this.denials[id] ?? false;
  }

  take(facts: VehicleFacts): void {
    void this.post('Take control', facts, 'take');
  }

  ask(facts: VehicleFacts): void {
    const reason = this.reason.trim().slice(0, REASON_MAX);
    this.denials[facts.id] = false;
    void this.post('Request control', facts, 'request', reason === '' ? {} : { reason });
  }

  /** Gives control up, or takes a request back. */
  release(facts: VehicleFacts): void {
    void this.post('Release control', facts, 'release');
  }

  grant(facts: VehicleFacts, to: ControlRequest): void {
    void this.post('Give control', facts, 'grant', { client: to.key });
  }

  deny(facts: VehicleFacts, to: ControlRequest): void {
    void this.post('Keep control', facts, 'deny', { client: to.key });
  }

  /** Keyboard answer to the first request; false if there is none. */
  answer(facts: VehicleFacts | null, give: boolean): boolean {
    const asking = facts === null ? null : toAnswer(facts.control, this.api.key);
    if (facts === null || asking === null) return false;
    if (give) this.grant(facts, asking);
    else this.deny(facts, asking);
    return true;
  }

  /** Handles control events: a denial of this page's request is kept until control changes. */
  heard(event: WireEvent): void {
    if (event.kind !== 'control' || event.vehicle === null) return;
    if (event['action'] === 'denied' && event['to_key'] === this.api.key) this.denials[event.vehicle] = true;
    if (event['previous_key'] !== null && event['previous_key'] !== undefined) this.denials[event.vehicle] = false;
  }

  private async post(what: string, facts: VehicleFacts, call: string, body?: object): Promise<void> {
    await this.actions.attempt(what, facts, 'control', () => this.api.post(`/vehicles/${encodeURIComponent(facts.id)}/control/${call}`, body));
  }
}
