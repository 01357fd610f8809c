/** State of the parameter panel; reads the vehicle's parameters and sets them. */

import { ofVehicle, type ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import { NO_FILTER, type Filter, type Parameters } from './params';

/** Poll interval while the parameters are read [ms]. */
const POLL_MS = 500;

class ParamPanelState {
  open = $state(false);
  filter = $state.raw<Filter>(NO_FILTER);
  /** The parameters that the server has read; null: not requested yet. */
  parametersView = $state.raw<Parameters | null>(null);
  problem = $state.raw<Problem | null>(null);
  /** Name of the parameter whose editor is open. */
  editedName = $state<string | null>(null);
  busy = $state(false);
  /** Number of the latest call of `show`; earlier calls stop polling. */
  private latestShowNumber = 0;

  toggle(): void {
    this.open = !this.open;
  }

  close(): void {
    this.open = false;
    this.latestShowNumber += 1; // the running call of `show` stops polling
  }

  /**
   * Shows the parameters that the server has read. If some are missing, or with `readAgain`, the server reads all
   * parameters from the vehicle, and this function polls until they are read.
   */
  async show(api: ApiClient, vehicle: string, readAgain = false): Promise<void> {
    const showNumber = ++this.latestShowNumber;
    this.problem = null;
    if (this.parametersView?.vehicle !== vehicle) {
      this.parametersView = null;
      this.editedName = null;
    }
    await this.poll(api, vehicle, showNumber);
    if (showNumber !== this.latestShowNumber) return;
    if (readAgain || this.parametersView?.list.state !== 'ready') {
      const refresh = await api.post('/vehicles/{v}/params/refresh', ofVehicle(vehicle));
      if (showNumber !== this.latestShowNumber) return;
      if (!refresh.ok) {
        this.problem = refresh.problem;
        return;
      }
    }
    do {
      await new Promise((resolve) => setTimeout(resolve, POLL_MS));
      if (showNumber !== this.latestShowNumber) return;
      await this.poll(api, vehicle, showNumber);
    } while (showNumber === this.latestShowNumber && this.isIncomplete());
  }

  /** Sets a parameter, and stores the value that the vehicle reports. @returns whether the vehicle set the parameter. */
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
    const { parametersView } = this;
    if (parametersView?.vehicle === vehicle) {
      this.parametersView = { ...parametersView, params: parametersView.params.map((p) => (p.name === name ? outcome.value : p)) };
    }
    return true;
  }

  private isIncomplete(): boolean {
    const list = this.parametersView?.list;
    return list === undefined || list.state === 'reading' || (list.state === 'ready' && !list.facts && list.facts_problem === null);
  }

  private async poll(api: ApiClient, vehicle: string, showNumber: number): Promise<void> {
    const outcome = await api.get('/vehicles/{v}/params', ofVehicle(vehicle));
    if (showNumber !== this.latestShowNumber) return;
    if (outcome.ok) this.parametersView = outcome.value;
    else this.problem = outcome.problem;
  }
}

export const paramPanel = new ParamPanelState();
