/** State of the list of vehicles; switches vehicles to Hold and removes vehicles whose connection is lost. */

import { ofVehicle, type ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import { CommandGate, DOUBLE_CLICK } from '../../app/actions/command.svelte';
import { holdText, type Filter, type Sorting } from './fleet';

const problemText = (problem: Problem): string => [problem.detail, problem.remedy].filter(Boolean).join(' ');

const HOLD = 'Hold all flying';

export class VehicleList {
  text = $state('');
  filter = $state<Filter>('all');
  sorting = $state<Sorting>('number');
  /** Ids of the vehicles that are chosen for a command. */
  chosen = $state.raw<ReadonlySet<string>>(new Set());
  /** Result of the last command; null before the first command. */
  result = $state.raw<{ text: string; refused: boolean } | null>(null);

  constructor(private readonly gate = new CommandGate()) {}

  choose(id: string, isChosen: boolean): void {
    const others = [...this.chosen].filter((other) => other !== id);
    this.chosen = new Set(isChosen ? [...others, id] : others);
  }

  /** Whether the server has not answered Hold for these vehicles yet. */
  isHoldWaiting(vehicles: readonly { id: string }[]): boolean {
    return this.gate.isWaiting({ name: HOLD, vehicles: vehicles.map(({ id }) => id) });
  }

  /** Sends Hold to these vehicles in one request, without asking the person for confirmation. */
  async hold(api: ApiClient, vehicles: readonly { id: string; name: string }[]): Promise<void> {
    if (vehicles.length === 0) return;
    const ids = vehicles.map((vehicle) => vehicle.id);
    const outcome = await this.gate.run({ name: HOLD, vehicles: ids, stops: true }, () => api.post('/hold', { body: { vehicles: ids } }));
    if (outcome.ok) {
      const unconfirmedIds = new Set(outcome.value.results.filter((result) => !result.held).map((result) => result.vehicle));
      const unconfirmedNames = vehicles.filter((vehicle) => unconfirmedIds.has(vehicle.id)).map((vehicle) => vehicle.name);
      this.result = { text: holdText(vehicles.length, unconfirmedNames), refused: unconfirmedNames.length > 0 };
    } else if (outcome.problem.code !== DOUBLE_CLICK) {
      this.result = { text: problemText(outcome.problem), refused: true };
    }
  }

  /** Removes a vehicle whose connection is lost; `result` contains the refusal, if any. */
  async remove(api: ApiClient, vehicle: { id: string; name: string }): Promise<void> {
    const outcome = await this.gate.run({ name: 'Remove', vehicles: [vehicle.id] }, () => api.delete('/vehicles/{v}', ofVehicle(vehicle.id)));
    if (!outcome.ok && outcome.problem.code === DOUBLE_CLICK) return;
    const text = outcome.ok ? `${vehicle.name} was removed.` : problemText(outcome.problem);
    this.result = { text, refused: !outcome.ok };
  }
}
