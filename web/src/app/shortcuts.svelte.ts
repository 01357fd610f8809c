/** Whether the page's single-key shortcuts work; who dictates or hits keys by accident switches them off (WCAG 2.1.4). */

import { memory } from './identity';

type Kept = Pick<Storage, 'getItem' | 'setItem' | 'removeItem'>;

const KEY = 'gcs-shortcuts';

export class Shortcuts {
  on = $state(true);

  /** @param kept the browser's memory: the setting outlives the page. */
  constructor(private readonly kept: Kept) {
    this.on = kept.getItem(KEY) !== 'off';
  }

  set(on: boolean): void {
    this.on = on;
    if (on) this.kept.removeItem(KEY);
    else this.kept.setItem(KEY, 'off');
  }
}

export const shortcuts = new Shortcuts(memory(() => localStorage));
