/** State and requests of the readiness panel. */

import { ofVehicle, type ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';

class ReadinessPanel {
  open = $state(false);
  checking = $state(false);
  switching = $state(false);
  problem = $state.raw<Problem | null>(null);

  toggle(): void {
    this.open = !this.open;
    this.problem = null;
  }

  close(): void {
    this.open = false;
    this.problem = null;
  }

  /** Switches the vehicle to a mode in which it can be armed. A running check does not prevent this. */
  async switchMode(api: ApiClient, vehicle: string, mode: string): Promise<void> {
    if (this.switching) return;
    this.switching = true;
    this.problem = null;
    const outcome = await api.post('/vehicles/{v}/mode', { ...ofVehicle(vehicle), body: { mode } });
    this.switching = false;
    if (!outcome.ok) this.problem = outcome.problem;
  }

  /** Makes the vehicle run its checks; the results come with the telemetry. */
  async check(api: ApiClient, vehicle: string): Promise<void> {
    if (this.checking) return;
    this.checking = true;
    this.problem = null;
    const outcome = await api.post('/vehicles/{v}/readiness/check', ofVehicle(vehicle));
    this.checking = false;
    if (!outcome.ok) this.problem = outcome.problem;
  }
}

export const readinessPanel = new ReadinessPanel();
