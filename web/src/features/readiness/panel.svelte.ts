/** The readiness panel: open or not, and the vehicle asked to look again. */

import { ofVehicle, type ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';

class ReadinessPanel {
  open = $state(false);
  asking = $state(false);
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

  /** Does what the server offers: a mode in which the vehicle can be armed. A check on its way does not hold it up. */
  async choose(api: ApiClient, vehicle: string, mode: string): Promise<void> {
    if (this.choosing) return;
    this.choosing = true;
    this.problem = null;
    const outcome = await api.post('/vehicles/{v}/mode', { ...ofVehicle(vehicle), body: { mode } });
    this.choosing = false;
    if (!outcome.ok) this.problem = outcome.problem;
  }

  /** Has the vehicle run its checks; what they say comes with the telemetry. */
  async check(api: ApiClient, vehicle: string): Promise<void> {
    if (this.asking) return;
    this.asking = true;
    this.problem = null;
    const outcome = await api.post('/vehicles/{v}/readiness/check', ofVehicle(vehicle));
    this.asking = false;
    if (!outcome.ok) this.problem = outcome.problem;
  }
}

export const readiness = new ReadinessPanel();
