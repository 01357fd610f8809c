/** State of the parameter panel: the parameters read so far, and setting a parameter. */

import { ofVehicle, type ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import { NO_FILTER, type Filter, type Parameters } from './params';

/** Poll interval while the parameters are read [ms]. */
const POLL_MS = 500;

class ParamPanel {
  open = $state(false);
  filter = $state.raw<Filter>(NO_FILTER);
  content = $state.raw<Parameters | null>(null);
  problem = $state.raw<Problem | null>(null);
  /** Name of the parameter whose editor is open. */
  chosen = $state<string | null>(null);
  busy = $state(false);
  private polls = 0;

  toggle(): void {
    this.open = !this.open;
  }

  close(): void {
    this.open = false;
    this.polls += 1; // ends the polling
  }

  /** Loads the parameters, starts reading them if needed, and polls until all are read. */
  async show(api: ApiClient, vehicle: string, again = false): Promise<void> {
    const pollNumber = ++this.polls;
    this.problem = null;
    if (this.content?.vehicle !== vehicle) {
      this.content = null;
      this.chosen = null;
    }
    await this.poll(api, vehicle, pollNumber);
    if (pollNumber !== this.polls) return;
    if (again || this.content?.list.state !== 'ready') {
      const begun = await api.post('/vehicles/{v}/params/refresh', ofVehicle(vehicle));
      if (pollNumber !== this.polls) return;
      if (!begun.ok) {
        this.problem = begun.problem;
        return;
      }
    }
    do {
      await new Promise((resolve) => setTimeout(resolve, POLL_MS));
      if (pollNumber !== this.polls) return;
      await this.poll(api, vehicle, pollNumber);
    } while (pollNumber === this.polls && this.unfinished());
  }

  /** Sets a parameter, and stores the value that the vehicle then reports. @returns whether it was set. */
  async set(api: ApiClient, vehicle: string, name: string, value: number, force = false): Promise<boolean> {
    if (this.busy) return false;
    this.busy = true;
    this.problem = null;
    const outcome = await api.put('/vehicles/{v}/params/{name}', { params: { path: { v: vehicle, name } }, body: force ? { value, force } : { value } });
    this.busy = false;
    if (!outcome.ok) {
      this.problem = outcome.problem;
      return false;
    }
    const content = this.content;
    if (content?.vehicle === vehicle) {
      this.content = { ...content, params: content.params.map((p) => (p.name === name ? outcome.value : p)) };
    }
    return true;
  }

  private unfinished(): boolean {
    const list = this.content?.list;
    return list === undefined || list.state === 'reading' || (list.state === 'ready' && !list.facts && list.facts_problem === null);
  }

  private async poll(api: ApiClient, vehicle: string, pollNumber: number): Promise<void> {
    const outcome = await api.get('/vehicles/{v}/params', ofVehicle(vehicle));
    if (pollNumber !== this.polls) return;
    if (outcome.ok) this.content = outcome.value;
    else this.problem = outcome.problem;
  }
}

export const params = new ParamPanel();
