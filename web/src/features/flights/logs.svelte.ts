/** The flight logs on a vehicle: the list, and the download of one log to the server. */

import { ofVehicle, type ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import { CommandGate, DOUBLE_CLICK } from '../../app/actions/command.svelte';
import { follow, type Operation } from '../../app/follow';

export type VehicleLog = components['schemas']['LogView'];

export class VehicleLogs {
  private list = $state.raw<{ readonly vehicle: string; readonly logs: readonly VehicleLog[] } | null>(null);
  private lastProblem = $state.raw<{ readonly vehicle: string; readonly problem: Pick<Problem, 'title' | 'detail'> } | null>(null);
  /** The newest download that this page has started. */
  operation = $state.raw<Operation | null>(null);
  /** Id of the vehicle whose list is being read. */
  reading = $state<string | null>(null);
  /** Id of the vehicle whose logs are erased once a person has confirmed it. */
  toErase = $state<string | null>(null);

  /** The newest log stream of the selected vehicle. */
  private streamed = $state.raw<Operation | null>(null);

  constructor(private readonly gate = new CommandGate()) {}

  /** The logs of a vehicle; null: not read yet. */
  logsOf(vehicle: string): readonly VehicleLog[] | null {
    return this.list?.vehicle === vehicle ? this.list.logs : null;
  }

  /** Why the last request about this vehicle failed; null: it did not fail. */
  problemOf(vehicle: string): Pick<Problem, 'title' | 'detail'> | null {
    return this.lastProblem?.vehicle === vehicle ? this.lastProblem.problem : null;
  }

  /** The running download of this vehicle's log. */
  downloadOf(vehicle: string, number: number): Operation | null {
    const { operation } = this;
    return operation?.state === 'running' && operation.vehicle === vehicle && operation.subject === String(number) ? operation : null;
  }

  /** The newest log stream of this vehicle, running or ended; null: none. */
  streamOf(vehicle: string): Operation | null {
    return this.streamed?.vehicle === vehicle ? this.streamed : null;
  }

  /** Finds a running log stream of this vehicle, whoever started it, and follows it. */
  async findStream(api: ApiClient, vehicle: string): Promise<void> {
    const response = await api.get('/operations');
    const found = response.ok
      ? response.value.operations.find(({ kind, state, vehicle: of }) => kind === 'logs/stream' && state === 'running' && of === vehicle)
      : undefined;
    if (found !== undefined && this.streamed?.id !== found.id) await this.followStream(api, found);
  }

  /** Lets the vehicle stream its log while it writes it, and follows the stream to its end. */
  async stream(api: ApiClient, vehicle: string): Promise<void> {
    this.lastProblem = null;
    const outcome = await this.gate.run({ name: 'Stream the log', vehicles: [vehicle] }, () => api.post('/vehicles/{v}/logs/stream', ofVehicle(vehicle)));
    if (outcome.ok) await this.followStream(api, outcome.value);
    else if (outcome.problem.code !== DOUBLE_CLICK) this.lastProblem = { vehicle, problem: outcome.problem };
  }

  /** Stops the stream; what was received stays. */
  async stopStream(api: ApiClient, vehicle: string): Promise<void> {
    const outcome = await this.gate.run({ name: 'Stop the log stream', vehicles: [vehicle] }, () =>
      api.delete('/vehicles/{v}/logs/stream', ofVehicle(vehicle)),
    );
    if (!outcome.ok && outcome.problem.code !== DOUBLE_CLICK) this.lastProblem = { vehicle, problem: outcome.problem };
  }

  private async followStream(api: ApiClient, begun: Operation): Promise<void> {
    await follow(api, begun, (operation) => {
      if (this.streamed?.id !== begun.id && operation !== begun) return false;
      this.streamed = operation;
      if (operation.error !== null && operation.vehicle !== null) this.lastProblem = { vehicle: operation.vehicle, problem: operation.error };
      return true;
    });
  }

  async read(api: ApiClient, vehicle: string): Promise<void> {
    this.lastProblem = null;
    this.reading = vehicle;
    const response = await api.get('/vehicles/{v}/logs', ofVehicle(vehicle));
    if (this.reading !== vehicle) return;
    this.reading = null;
    if (response.ok) this.list = { vehicle, logs: response.value.logs };
    else this.lastProblem = { vehicle, problem: response.problem };
  }

  /** Downloads a log to the server, and follows the download to its end. */
  async download(api: ApiClient, vehicle: string, number: number): Promise<void> {
    this.lastProblem = null;
    const outcome = await this.gate.run({ name: 'Download a log', vehicles: [vehicle], part: String(number) }, () =>
      api.post('/vehicles/{v}/logs/{number}/download', { params: { path: { v: vehicle, number } } }),
    );
    if (!outcome.ok) {
      if (outcome.problem.code !== DOUBLE_CLICK) this.lastProblem = { vehicle, problem: outcome.problem };
      return;
    }
    this.operation = outcome.value;
    const current = await follow(api, outcome.value, (operation) => {
      if (this.operation?.id !== operation.id) return false;
      this.operation = operation;
      return true;
    });
    if (this.operation.id !== current.id) return;
    const { state, error, result } = current;
    if (error !== null) this.lastProblem = { vehicle, problem: error };
    if (this.list?.vehicle !== vehicle) return;
    const change = (changed: Partial<VehicleLog>): void => {
      if (this.list !== null) this.list = { vehicle, logs: this.list.logs.map((log) => (log.number === number ? { ...log, ...changed } : log)) };
    };
    if (state === 'succeeded') {
      const { file, flight } = result as unknown as { file: string; flight: string };
      change({ received_bytes: 0, downloaded: { file, flight } });
      return;
    }
    const size_bytes = this.list.logs.find((log) => log.number === number)?.size_bytes ?? 0;
    change({ received_bytes: Math.round((current.progress ?? 0) * size_bytes) });
  }

  /** Erases all logs on the vehicle. @param vehicle the vehicle for which a person has confirmed it. */
  async erase(api: ApiClient, vehicle: string): Promise<void> {
    this.lastProblem = null;
    this.toErase = null;
    const outcome = await this.gate.run({ name: 'Erase the logs', vehicles: [vehicle] }, () =>
      api.post('/vehicles/{v}/logs/erase', { ...ofVehicle(vehicle), body: { confirm: `all logs of vehicle ${vehicle} are erased` } }),
    );
    if (outcome.ok)
      this.list = { vehicle, logs: [] }; // the vehicle lists none any more
    else if (outcome.problem.code !== DOUBLE_CLICK) this.lastProblem = { vehicle, problem: outcome.problem };
  }

  /** Cancels the running download; what has arrived stays, and the next one continues there. */
  async cancel(api: ApiClient): Promise<void> {
    const { operation } = this;
    if (operation?.vehicle == null) return;
    const outcome = await this.gate.run({ name: 'Cancel the download', vehicles: [operation.vehicle] }, () =>
      api.delete('/operations/{o}', { params: { path: { o: operation.id } } }),
    );
    if (!outcome.ok && outcome.problem.code !== DOUBLE_CLICK) this.lastProblem = { vehicle: operation.vehicle, problem: outcome.problem };
  }
}
