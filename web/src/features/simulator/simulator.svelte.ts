/** The simulated vehicles that the server runs, read again and again while somebody looks at them. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';

export type Simulator = components['schemas']['Simulator'];
type Instance = components['schemas']['SimulatorInstance'];

const POLL_MS = 2000;

export class SimulatorView {
  /** The newest answer; null: none yet. */
  state = $state.raw<Simulator | null>(null);
  problem = $state.raw<Pick<Problem, 'title' | 'detail'> | null>(null);
  private reading = false;

  /** Reads until the returned function is called. An answer that does not come is waited for, and not asked again. */
  watch(api: ApiClient): () => void {
    void this.read(api);
    const timer = setInterval(() => void this.read(api), POLL_MS);
    return () => clearInterval(timer);
  }

  private async read(api: ApiClient): Promise<void> {
    if (this.reading) return;
    this.reading = true;
    const response = await api.get('/simulator');
    this.reading = false;
    if (response.ok) this.state = response.value;
    this.problem = response.ok ? null : response.problem;
  }
}

/** What runs, as a sentence. */
export function kindText(state: Simulator): string {
  if (state.kind === null) return 'This server runs no simulated vehicle.';
  if (state.kind === 'bundled') return 'The vehicles are simulated by this program’s own PX4. Real ones: gcs serve --sim px4';
  return `${state.source ?? 'PX4'}; ${state.agent ?? ''}`;
}

/** An instance's state beside its number. */
export function instanceText(instance: Instance): string {
  const restarts = instance.restarts === 0 ? '' : ` · restarted ${instance.restarts} ×`;
  return `vehicle ${instance.system_id} · ${instance.state}${restarts}`;
}
