/** State of the list of vehicles; switches vehicles to Hold and removes vehicles whose connection is lost. */

import { ofVehicle, type ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import { holdText, type Filter } from './fleet';

const problemText = (problem: Problem): string => [problem.detail, problem.remedy].filter(Boolean).join(' ');

class VehicleList {
  open = $state(false);
  text = $state('');
  filter = $state<Filter>('all');
  /** Whether the page is waiting for the result of a Hold command. */
  isHoldPending = $state(false);
  /** Result of the last command; null before the first command. */
  result = $state.raw<{ text: string; refused: boolean } | null>(null);

  toggle(): void {
    this.open = !this.open;
    if (!this.open) this.result = null;
  }

  close(): void {
    this.open = false;
    this.result = null;
  }

  /** Sends Hold to these vehicles in one request, without asking the person for confirmation. */
  async hold(api: ApiClient, vehicles: readonly { id: string; name: string }[]): Promise<void> {
    if (this.isHoldPending || vehicles.length === 0) return;
    this.result = null;
    this.isHoldPending = true;
    const outcome = await api.post('/hold', { body: { vehicles: vehicles.map((vehicle) => vehicle.id) } });
    this.isHoldPending = false;
    if (outcome.ok) {
      const unconfirmedIds = new Set(outcome.value.results.filter((result) => !result.held).map((result) => result.vehicle));
      const unconfirmedNames = vehicles.filter((vehicle) => unconfirmedIds.has(vehicle.id)).map((vehicle) => vehicle.name);
      this.result = { text: holdText(vehicles.length, unconfirmedNames), refused: unconfirmedNames.length > 0 };
    } else {
      this.result = { text: problemText(outcome.problem), refused: true };
    }
  }

  /** Removes a vehicle whose connection is lost; `result` contains the refusal, if any. */
  async remove(api: ApiClient, vehicle: { id: string; name: string }): Promise<void> {
    const outcome = await api.delete('/vehicles/{v}', ofVehicle(vehicle.id));
    const text = outcome.ok ? `${vehicle.name} was removed.` : problemText(outcome.problem);
    this.result = { text, refused: !outcome.ok };
  }
}

export const vehicleList = new VehicleList();
