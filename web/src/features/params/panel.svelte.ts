/** State of the parameter panel; reads the vehicle's parameters and sets them. */

import { ofVehicle, type ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import { CommandGate, DOUBLE_CLICK } from '../../app/actions/command.svelte';
import { NO_FILTER, type Filter, type Parameters } from './params';

/** Poll interval while the parameters are read [ms]. */
const POLL_MS = 500;

/** Name of the command that sets a parameter. */
const SET = 'Set parameter';

export class ParamPanelState {
  filter = $state.raw<Filter>(NO_FILTER);
  /** The parameters that the server has read; null: not requested yet. */
  parametersView = $state.raw<Parameters | null>(null);
  private lastProblem = $state.raw<{ readonly vehicle: string; readonly problem: Problem } | null>(null);
  /** Name of the parameter whose editor is open. */
  editedName = $state<string | null>(null);
  /** Number of the latest call of `show`; earlier calls stop polling. */
  private latestShowNumber = 0;

  constructor(private readonly gate = new CommandGate()) {}

  /** Why the last request to this vehicle failed; null: it did not fail. */
  problemOf(vehicle: string): Problem | null {
    return this.lastProblem?.vehicle === vehicle ? this.lastProblem.problem : null;
  }

  clearProblem(): void {
    this.lastProblem = null;
  }

  /** Whether the vehicle has not answered the new value of a parameter yet. */
  isSetting(vehicle: string, name: string): boolean {
    return this.gate.isWaiting({ name: SET, vehicles: [vehicle], part: name });
  }

  /** The panel has closed: the running call of `show` stops polling. */
  stop(): void {
    this.latestShowNumber += 1;
  }

  /**
   * Shows the parameters that the server has read. If some are missing, or with `readAgain`, the server reads all
   * parameters from the vehicle, and this function polls until they are read.
   */
  async show(api: ApiClient, vehicle: string, readAgain = false): Promise<void> {
    const showNumber = ++this.latestShowNumber;
    this.lastProblem = null;
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
        this.lastProblem = { vehicle, problem: refresh.problem };
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
    this.lastProblem = null;
    const outcome = await this.gate.run({ name: SET, vehicles: [vehicle], part: name }, () =>
      api.put('/vehicles/{v}/params/{name}', { params: { path: { v: vehicle, name } }, body: force ? { value, force } : { value } }),
    );
    if (!outcome.ok) {
      if (outcome.problem.code !== DOUBLE_CLICK) this.lastProblem = { vehicle, problem: outcome.problem };
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
    else this.lastProblem = { vehicle, problem: outcome.problem };
  }
}
