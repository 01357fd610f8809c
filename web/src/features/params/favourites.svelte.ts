/** The parameters that a person has marked; a setting of the user. */

import { userSettings } from '../../app/settings.svelte';

const MAX_FAVOURITES = 200;

class Favourites {
  readonly names: ReadonlySet<string> = $derived(new Set(userSettings.get('param_favourites')));

  toggle(name: string): void {
    const names = new Set(this.names);
    if (!names.delete(name) && names.size < MAX_FAVOURITES) names.add(name);
    userSettings.set('param_favourites', [...names]);
  }
}

export const favourites = new Favourites();
