/** The server's offline maps, requested when the map is first shown. */

import type { ApiClient } from '../../api/client';
import { offlineMap, type OfflineMap } from './offline-maps';

class Maps {
  list = $state.raw<readonly OfflineMap[]>([]);
  /** Files that cannot be shown, each with its reason. */
  unreadable = $state.raw<readonly string[]>([]);
  private asked = false;

  async ask(api: ApiClient): Promise<void> {
    if (this.asked) return;
    this.asked = true;
    const answer = await api.get('/maps');
    this.asked = answer.ok;
    if (!answer.ok) return;
    this.list = answer.value.maps.map((file) => offlineMap(file, location.origin));
    this.unreadable = answer.value.unreadable;
  }
}

export const maps = new Maps();
