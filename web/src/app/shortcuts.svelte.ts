/** Whether the page's single-key shortcuts work. People who use speech input, or press keys by accident, can switch the shortcuts off (WCAG 2.1.4). */

import { memory } from './identity';

type SettingStorage = Pick<Storage, 'getItem' | 'setItem' | 'removeItem'>;

const KEY = 'gcs-shortcuts';

export class Shortcuts {
  on = $state(true);

  /** @param storage the browser's storage for the setting. */
  constructor(private readonly storage: SettingStorage) {
    this.on = storage.getItem(KEY) !== 'off';
  }

  set(on: boolean): void {
    this.on = on;
    if (on) this.storage.removeItem(KEY);
    else this.storage.setItem(KEY, 'off');
  }
}

export const shortcuts = new Shortcuts(memory(() => localStorage));
