/** Whether the page's single-key shortcuts work. People who use speech input, or press keys by accident, can switch the shortcuts off (WCAG 2.1.4). */

import { availableStorage } from './identity';

type SettingStorage = Pick<Storage, 'getItem' | 'setItem' | 'removeItem'>;

const KEY = 'gcs-shortcuts';

export class Shortcuts {
  enabled = $state(true);

  /** @param storage the browser's storage for the setting. */
  constructor(private readonly storage: SettingStorage) {
    this.enabled = storage.getItem(KEY) !== 'off';
  }

  setEnabled(enabled: boolean): void {
    this.enabled = enabled;
    if (enabled) this.storage.removeItem(KEY);
    else this.storage.setItem(KEY, 'off');
  }
}

export const shortcuts = new Shortcuts(availableStorage(() => localStorage));
