/** The server's offline maps, requested when the map is first shown. */

import type { ApiClient } from '../../api/client';
import { offlineMap, type OfflineMap } from './offline-maps';

class Maps {
  list = $state.raw<readonly OfflineMap[]>([]);
  /** Files that cannot be shown, each with its reason. */
  unreadable = $state.raw<readonly string[]>([]);
  private isRequested = false;

  async load(api: ApiClient): Promise<void> {
    if (this.isRequested) return;
    this.isRequested = true;
    const answer = await api.get('/maps');
    this.isRequested = answer.ok;
    if (!answer.ok) return;
    this.list = answer.value.maps.map((file) => offlineMap(file, location.origin));
    this.unreadable = answer.value.unreadable;
  }
}

export const maps = new Maps();
