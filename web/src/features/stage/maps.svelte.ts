/** The server's offline maps. The page requests them when it first shows the map. */

import type { ApiClient } from '../../api/client';
import { offlineMap, type OfflineMap } from './offline-maps';

class Maps {
  list = $state.raw<readonly OfflineMap[]>([]);
  /** Files that cannot be shown, each with its reason. */
  unreadableFiles = $state.raw<readonly string[]>([]);
  private isRequested = false;

  async load(api: ApiClient): Promise<void> {
    if (this.isRequested) return;
    this.isRequested = true;
    const response = await api.get('/maps');
    this.isRequested = response.ok;
    if (!response.ok) return;
    this.list = response.value.maps.map((file) => offlineMap(file, location.origin));
    this.unreadableFiles = response.value.unreadable;
  }
}

export const maps = new Maps();
