/** The futures of the command that an open confirmation asks about. The confirmation never waits for them. */

import { ofVehicle, type ApiClient } from '../../api/client';
import type { PendingConfirmation } from '../actions/controller.svelte';
import type { LayerContent } from '../map-layers.svelte';
import { futuresLayer, type Futures } from './futures';

/** Time from an answer to the next request while the confirmation is open: the vehicle moves on [ms]. */
const AGAIN_MS = 2000;
/** An older result is not shown any more, although the server is too busy for a newer one [ms]. */
const MAX_AGE_MS = 6000;
const BUSY = 429;

export type FuturesState =
  { readonly kind: 'computing' } | { readonly kind: 'known'; readonly result: Futures } | { readonly kind: 'none'; readonly why: string };

export class FuturesOfConfirmation {
  /** The state of the open confirmation's futures; null: it has none. */
  state = $state.raw<FuturesState | null>(null);
  private asked: AbortController | null = null;
  private known_ms = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;

  constructor(private readonly api: ApiClient) {}

  /** Follows a confirmation: asks for its futures, again and again, until another one is followed. @param confirmation null: none is open. */
  follow(confirmation: Pick<PendingConfirmation, 'command'> | null): void {
    this.asked?.abort();
    clearTimeout(this.timer);
    this.asked = null;
    const [vehicle, futures] = [confirmation?.command.vehicles[0], confirmation?.command.futures];
    this.state = vehicle === undefined || futures === undefined ? null : { kind: 'computing' };
    if (vehicle === undefined || futures === undefined) return;
    const asked = (this.asked = new AbortController());
    void this.ask(vehicle, futures, asked.signal);
  }

  /** What map and 3D view show; null: nothing. */
  layer(): LayerContent | null {
    return this.state?.kind === 'known' ? futuresLayer(this.state.result) : null;
  }

  private async ask(vehicle: string, futures: NonNullable<PendingConfirmation['command']['futures']>, signal: AbortSignal): Promise<void> {
    const outcome = await this.api.post('/vehicles/{v}/futures', { ...ofVehicle(vehicle), body: futures(), signal });
    if (signal.aborted) return; // another confirmation, or none
    if (outcome.ok) {
      this.state = { kind: 'known', result: outcome.value as Futures };
      this.known_ms = performance.now();
    } else if (outcome.problem.status !== BUSY || this.state?.kind !== 'known' || performance.now() - this.known_ms > MAX_AGE_MS)
      this.state = { kind: 'none', why: outcome.problem.detail };
    this.timer = setTimeout(() => void this.ask(vehicle, futures, signal), AGAIN_MS);
  }
}
