/** The values on the grid and their order, as chosen by the person; the browser stores them. */

import { QUANTITIES_BY_ID, moveItem, readChoice, DEFAULT_IDS } from './catalogue';

const STORAGE_KEY = 'gcs-values';
/** More values would push the other cards off the screen. */
export const MAX_VALUES = 18;

function storedIds(): string | null {
  try {
    return localStorage.getItem(STORAGE_KEY);
  } catch {
    return null; // storage is disabled
  }
}

class ValueChoice {
  ids = $state.raw<readonly string[]>(readChoice(storedIds()));
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
    this.store([...DEFAULT_IDS]);
  }

  private store(ids: readonly string[]): void {
    this.ids = ids;
    try {
      localStorage.setItem(STORAGE_KEY, JSON.stringify(ids));
    } catch {
      // storage is disabled: the choice applies until the page closes
    }
  }
}

export const valueChoice = new ValueChoice();
