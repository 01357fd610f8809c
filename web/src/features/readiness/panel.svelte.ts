/** State and requests of the readiness panel. */

import { ofVehicle, type ApiClient, type Outcome } from '../../api/client';
import type { Problem } from '../../api/problems';
import { CommandGate, DOUBLE_CLICK } from '../../app/actions/command.svelte';

const SWITCH = 'Switch mode';
const CHECK = 'Run the checks';

export class ReadinessPanel {
  private lastProblem = $state.raw<{ readonly vehicle: string; readonly problem: Problem } | null>(null);

  constructor(private readonly gate = new CommandGate()) {}

  clearProblem(): void {
    this.lastProblem = null;
  }

  /** Why the last command to this vehicle failed; null: it did not fail. */
  problemOf(vehicle: string): Problem | null {
    return this.lastProblem?.vehicle === vehicle ? this.lastProblem.problem : null;
  }

  isSwitching(vehicle: string): boolean {
    return this.gate.isWaiting({ name: SWITCH, vehicles: [vehicle] });
  }

  isChecking(vehicle: string): boolean {
    return this.gate.isWaiting({ name: CHECK, vehicles: [vehicle] });
  }

  /** Switches the vehicle to a mode in which it can be armed. A running check does not prevent this. */
  async switchMode(api: ApiClient, vehicle: string, mode: string): Promise<void> {
    await this.send(SWITCH, vehicle, () => api.post('/vehicles/{v}/mode', { ...ofVehicle(vehicle), body: { mode } }));
  }

  /** Makes the vehicle run its checks; the results come with the telemetry. */
  async check(api: ApiClient, vehicle: string): Promise<void> {
    await this.send(CHECK, vehicle, () => api.post('/vehicles/{v}/readiness/check', ofVehicle(vehicle)));
  }

  private async send(name: string, vehicle: string, request: () => Promise<Outcome<unknown>>): Promise<void> {
    this.lastProblem = null;
    const outcome = await this.gate.run({ name, vehicles: [vehicle] }, request);
    if (!outcome.ok && outcome.problem.code !== DOUBLE_CLICK) this.lastProblem = { vehicle, problem: outcome.problem };
  }
}
