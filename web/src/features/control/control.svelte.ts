/** Takes, requests, gives and releases control of the selected vehicle. */

import { commandTo } from '../../app/actions/command.svelte';
import type { VehicleFacts } from '../../vehicle/facts';
import { ofVehicle, type ApiClient, type Outcome } from '../../api/client';
import type { WireEvent } from '../../live/wire';
import type { ActionController } from '../../app/actions/controller.svelte';
import { requestToAnswer, type ControlRequest } from '../../vehicle/control';

const MAX_REASON_LENGTH = 200;

export class ControlController {
  open = $state(false);
  reason = $state('');
  /** Vehicles for which the controlling client denied this page's request. */
  private readonly denials = $state<Record<string, boolean>>({});

  constructor(
    private readonly api: ApiClient,
    private readonly actions: ActionController,
  ) {}

  toggle(): boolean {
    this.open = !this.open;
    return true;
  }

  wasDenied(id: string): boolean {
    return this.denials[id] ?? false;
  }

  take(facts: VehicleFacts): void {
    void this.attempt('Take control', facts, () => this.api.post('/vehicles/{v}/control/take', ofVehicle(facts.id)));
  }

  requestControl(facts: VehicleFacts): void {
    const reason = this.reason.trim().slice(0, MAX_REASON_LENGTH);
    this.denials[facts.id] = false;
    const body = reason === '' ? {} : { reason };
    void this.attempt('Request control', facts, () => this.api.post('/vehicles/{v}/control/request', { ...ofVehicle(facts.id), body }));
  }

  /** Releases control, or withdraws a request. */
  release(facts: VehicleFacts): void {
    void this.attempt('Release control', facts, () => this.api.post('/vehicles/{v}/control/release', ofVehicle(facts.id)));
  }

  grant(facts: VehicleFacts, request: ControlRequest): void {
    const body = { client: request.key };
    void this.attempt('Give control', facts, () => this.api.post('/vehicles/{v}/control/grant', { ...ofVehicle(facts.id), body }));
  }

  deny(facts: VehicleFacts, request: ControlRequest): void {
    const body = { client: request.key };
    void this.attempt('Keep control', facts, () => this.api.post('/vehicles/{v}/control/deny', { ...ofVehicle(facts.id), body }));
  }

  /** Handles the keys that answer the first request. @returns false: no client requests control. */
  answer(facts: VehicleFacts | null, isGranted: boolean): boolean {
    const request = facts === null ? null : requestToAnswer(facts.control, this.api.key);
    if (facts === null || request === null) return false;
    if (isGranted) this.grant(facts, request);
    else this.deny(facts, request);
    return true;
  }

  /** Handles control events: stores a denial of this page's request until the controlling client changes. */
  handleEvent(event: WireEvent): void {
    if (event.kind !== 'control' || event.vehicle === null) return;
    if (event['action'] === 'denied' && event['to_key'] === this.api.key) this.denials[event.vehicle] = true;
    if (event['previous_key'] !== null && event['previous_key'] !== undefined) this.denials[event.vehicle] = false;
  }

  private async attempt(commandName: string, facts: VehicleFacts, sendRequest: () => Promise<Outcome<unknown>>): Promise<void> {
    await this.actions.attempt(commandTo(facts, commandName, sendRequest), 'control');
  }
}
