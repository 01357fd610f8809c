/** The logs of flights that have ended, as the server reports them for each vehicle. */

import { page } from '../../app/page.svelte';
import type { components } from '../../api/schema';

export type LandedLog = components['schemas']['LandedLogView'];

/** What happens with the log of a vehicle's newest flight; null: nothing. */
export function landedLog(id: string): LandedLog | null {
  const log = page.store.vehicles.get(id)?.newestSample('landed_log')?.value as LandedLog | undefined;
  return log === undefined || log.state === 'none' ? null : log;
}

/** Ids of the vehicles with such a log, the selected one first; read reactively. */
export function landedVehicles(): readonly string[] {
  return page.eachFleetRepaint(() => {
    const ids = page.ids.filter((id) => landedLog(id) !== null);
    return ids.sort((a, b) => Number(b === page.selectedId) - Number(a === page.selectedId));
  });
}
