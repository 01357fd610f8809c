/** The values on the grid and their order, as chosen by the person; kept in this browser. */

import { BY_ID, moved, readChoice, USUAL } from './catalogue';

const KEY = 'gcs-values';
/** A larger number would push the cards off the screen. */
export const MOST = 18;

function stored(): string | null {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null; // storage is disabled
  }
}

class ValueChoice {
  ids = $state.raw<readonly string[]>(readChoice(stored()));
  editing = $state(false);

  add(id: string): void {
    if (this.ids.length < MOST && BY_ID.has(id) && !this.ids.includes(id)) this.keep([...this.ids, id]);
  }

  remove(id: string): void {
    this.keep(this.ids.filter((other) => other !== id));
  }

  move(from: number, to: number): void {
    if (to >= 0 && to < this.ids.length && from !== to) this.keep(moved(this.ids, from, to));
  }

  reset(): void {
    this.keep([...USUAL]);
  }

  private keep(ids: readonly string[]): void {
    this.ids = ids;
    try {
      localStorage.setItem(KEY, JSON.stringify(ids));
    } catch {
      // storage is disabled: kept until the page closes
    }
  }
}

export const choice = new ValueChoice();
