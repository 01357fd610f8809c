/** State of the readiness panel, and the request that the vehicle runs its checks again. */

import { ofVehicle, type ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';

class ReadinessPanel {
  open = $state(false);
  checking = $state(false);
  choosing = $state(false);
  problem = $state.raw<Problem | null>(null);

  toggle(): void {
    this.open = !this.open;
    this.problem = null;
  }

  close(): void {
    this.open = false;
    this.problem = null;
  }

  /** Switches to a mode in which the vehicle can be armed. A running check does not delay it. */
  async choose(api: ApiClient, vehicle: string, mode: string): Promise<void> {
    if (this.choosing) return;
    this.choosing = true;
    this.problem = null;
    const outcome = await api.post('/vehicles/{v}/mode', { ...ofVehicle(vehicle), body: { mode } });
    this.choosing = false;
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

export const readiness = new ReadinessPanel();
