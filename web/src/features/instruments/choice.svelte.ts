/** The values on the grid and their order, as chosen by the person; a setting of the user. */

import { userSettings } from '../../app/settings.svelte';
import { QUANTITIES_BY_ID, moveItem, readChoice } from './catalogue';

/** More values would push the other cards off the screen. */
export const MAX_VALUES = 18;

class ValueChoice {
  readonly ids: readonly string[] = $derived(readChoice(userSettings.get('values')));
  editing = $state(false);

  add(id: string): void {
    if (this.ids.length < MAX_VALUES && QUANTITIES_BY_ID.has(id) && !this.ids.includes(id)) this.store([...this.ids, id]);
  }

  remove(id: string): void {
    this.store(this.ids.filter((other) => other !== id));
  }

  move(from: number, to: number): void {
    if (to >= 0 && to < this.ids.length && from !== to) this.store(moveItem(this.ids, from, to));
  }

  reset(): void {
    userSettings.set('values', null);
  }

  private store(ids: readonly string[]): void {
    userSettings.set('values', [...ids]);
  }
}

export const valueChoice = new ValueChoice();
