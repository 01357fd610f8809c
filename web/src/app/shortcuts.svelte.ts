/** Whether the page's single-key shortcuts work. People who use speech input, or press keys by accident, can switch the shortcuts off (WCAG 2.1.4). */

import { userSettings } from './settings.svelte';

class Shortcuts {
  readonly enabled = $derived(userSettings.get('single_keys') ?? true);

  setEnabled(enabled: boolean): void {
    userSettings.set('single_keys', enabled ? null : false);
  }
}

export const shortcuts = new Shortcuts();
