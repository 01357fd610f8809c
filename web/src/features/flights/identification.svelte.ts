/** What the open flight says of its aircraft. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import type { LogView } from './log-view.svelte';

export class Identification {
  found = $state.raw<components['schemas']['VehicleModel'] | null>(null);
  problem = $state.raw<Pick<Problem, 'title' | 'detail'> | null>(null);
  isBusy = $state(false);
  private request = 0;

  constructor(
    private readonly api: ApiClient,
    private readonly view: LogView,
  ) {}

  reset(): void {
    this.request += 1;
    this.found = this.problem = null;
    this.isBusy = false;
  }

  /** @param mass_kg null: not known. */
  async find(mass_kg: number | null): Promise<void> {
    const f = this.view.flight?.id;
    if (f === undefined || this.isBusy) return;
    const request = ++this.request;
    this.isBusy = true;
    const query = mass_kg === null ? {} : { mass_kg };
    const response = await this.api.get('/flights/{f}/model', { params: { path: { f }, query } });
    if (request !== this.request) return; // another flight was opened
    this.isBusy = false;
    this.problem = response.ok ? null : response.problem;
    this.found = response.ok ? response.value : null;
  }
}
