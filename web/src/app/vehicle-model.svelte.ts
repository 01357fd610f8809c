/** The kept models of vehicles: identified in a flight (Flights), used by dry runs (Plan). */

import type { ApiClient } from '../api/client';
import type { Problem } from '../api/problems';
import type { components } from '../api/schema';
import { page } from './page.svelte';

export type KeptModel = components['schemas']['KeptModel'];

export class VehicleModels {
  /** By vehicle: its kept model, or null if none is kept; missing: not read yet. */
  kept = $state.raw<ReadonlyMap<string, KeptModel | null>>(new Map());
  problem = $state.raw<{ readonly vehicle: string; readonly problem: Pick<Problem, 'title' | 'detail'> } | null>(null);
  isBusy = $state(false);

  constructor(private readonly api: ApiClient) {}

  /** The model of a vehicle; null: none is kept, or it was not read yet. */
  of(vehicle: string | null): KeptModel | null {
    return vehicle === null ? null : (this.kept.get(vehicle) ?? null);
  }

  problemOf(vehicle: string | null): Pick<Problem, 'title' | 'detail'> | null {
    return this.problem?.vehicle === vehicle ? this.problem.problem : null;
  }

  async load(vehicle: string): Promise<void> {
    const response = await this.api.get('/vehicles/{v}/model', { params: { path: { v: vehicle } } });
    if (response.ok) this.set(vehicle, response.value.model);
  }

  /** Identifies the model of a vehicle in a flight, and keeps it. @param mass_kg null: not known. */
  async keep(vehicle: string, flight: string, mass_kg: number | null): Promise<boolean> {
    if (this.isBusy) return false;
    this.isBusy = true;
    this.problem = null;
    const response = await this.api.put('/vehicles/{v}/model', { params: { path: { v: vehicle } }, body: { flight, mass_kg } });
    this.isBusy = false;
    if (response.ok) this.set(vehicle, response.value.model);
    else this.problem = { vehicle, problem: response.problem };
    return response.ok;
  }

  async forget(vehicle: string): Promise<boolean> {
    if (this.isBusy) return false;
    this.isBusy = true;
    this.problem = null;
    const response = await this.api.delete('/vehicles/{v}/model', { params: { path: { v: vehicle } } });
    this.isBusy = false;
    if (response.ok) this.set(vehicle, null);
    else this.problem = { vehicle, problem: response.problem };
    return response.ok;
  }

  private set(vehicle: string, model: KeptModel | null): void {
    this.kept = new Map(this.kept).set(vehicle, model);
  }
}

/** A value with its standard error. */
export const withError = (value: number, error: number | null, unit: string): string =>
  `${value.toFixed(2)} ${unit}${error === null ? '' : ` ± ${error.toFixed(2)}`}`;

export const vehicleModels = new VehicleModels(page.api);
