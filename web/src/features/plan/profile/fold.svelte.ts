/** Whether the altitude profile below the map is folded to its heading; kept by the browser. */

import { availableStorage } from '../../../app/identity';

const KEY = 'gcs.profile-folded';
/** Height of the folded profile [px]. */
export const FOLDED_PX = 48;

class ProfileFold {
  private readonly storage = availableStorage(() => localStorage);
  isFolded = $state(this.storage.getItem(KEY) === '1');

  toggle(): void {
    this.isFolded = !this.isFolded;
    if (this.isFolded) this.storage.setItem(KEY, '1');
    else this.storage.removeItem(KEY);
  }
}

export const profileFold = new ProfileFold();
