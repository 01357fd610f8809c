/** The list of vehicles: open or not, holding all that fly, removing those that are silent. */

import type { ApiClient } from '../../api/client';
import { heldWords, type Filter } from './fleet';

/** So many requests are under way at a time: a browser opens no more connections to one server anyway. */
const AT_ONCE = 6;

class VehicleList {
  open = $state(false);
  text = $state('');
  filter = $state<Filter>('all');
  /** How many vehicles still have to answer; null: none was asked. */
  holding = $state<number | null>(null);
  /** What came of it; null: nothing yet. */
  said = $state.raw<{ text: string; refused: boolean } | null>(null);

  toggle(): void {
    this.open = !this.open;
    if (!this.open) this.said = null;
  }

  close(): void {
    this.open = false;
    this.said = null;
  }

  /** Hold for each of them, at once and without a question, as Hold is everywhere. */
  async hold(api: ApiClient, vehicles: readonly { id: string; name: string }[]): Promise<void> {
    if (this.holding !== null || vehicles.length === 0) return;
    this.said = null;
    this.holding = vehicles.length;
    const refused: string[] = [];
    const waiting = [...vehicles];
    const worker = async (): Promise<void> => {
      for (let one = waiting.shift(); one !== undefined; one = waiting.shift()) {
        const outcome = await api.post(`/vehicles/${encodeURIComponent(one.id)}/hold`);
        if (!outcome.ok) refused.push(one.name);
        this.holding = (this.holding ?? 1) - 1;
      }
    };
    await Promise.all(Array.from({ length: AT_ONCE }, worker));
    this.holding = null;
    this.said = { text: heldWords(vehicles.length, refused), refused: refused.length > 0 };
  }

  /** Forgets a vehicle that is not heard any more; a refusal says why. */
  async remove(api: ApiClient, vehicle: { id: string; name: string }): Promise<void> {
    const outcome = await api.delete(`/vehicles/${encodeURIComponent(vehicle.id)}`);
    const text = outcome.ok ? `${vehicle.name} is removed.` : [outcome.problem.detail, outcome.problem.remedy].filter(Boolean).join(' ');
    this.said = { text, refused: !outcome.ok };
  }
}

export const list = new VehicleList();
