/** Whether the altitude profile below the map is folded to its heading; a setting of the user. */

import { userSettings } from '../../../app/settings.svelte';

/** Height of the folded profile [px]. */
export const FOLDED_PX = 48;

class ProfileFold {
  readonly isFolded = $derived(userSettings.get('profile_folded') ?? false);

  toggle(): void {
    userSettings.set('profile_folded', !this.isFolded);
  }
}

export const profileFold = new ProfileFold();
