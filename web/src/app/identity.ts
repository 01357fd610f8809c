/**
 * Who this page is to the server: a name for people, and an id that tells this tab from every other.
 *
 * The id lives as long as the tab, reloads included. A tab that was duplicated brings a copy of its original's: it is
 * known by the mark that a page leaves when it goes, which the copy of a living page lacks.
 */

import { pageName } from '../api/client';

const ID = 'gcs.client-id';
const LEFT = 'gcs.left';
const NAME = 'gcs.client-name';
const LONGEST_NAME = 40;

export interface Identity {
  name: string;
  readonly id: string;
  /** What the server tells clients apart by, made of the id; null until it has said so. */
  key: string | null;
}

type Memory = Pick<Storage, 'getItem' | 'setItem' | 'removeItem'>;

/** A browser's storage; where it is switched off, what is kept is gone with the page. */
export function memory(storage: () => Memory): Memory {
  try {
    const found = storage();
    found.getItem(ID);
    return found;
  } catch {
    const kept = new Map<string, string>();
    return { getItem: (key) => kept.get(key) ?? null, setItem: (key, value) => void kept.set(key, value), removeItem: (key) => void kept.delete(key) };
  }
}

/** The identity of this tab; made where there is none yet, or where it is another tab's. */
export function identity(tab: Memory, browser: Memory, random: () => number = Math.random): Identity {
  const known = tab.getItem(LEFT) === null ? null : tab.getItem(ID);
  tab.removeItem(LEFT);
  const id =
    known ??
    Array.from({ length: 4 }, () =>
      Math.floor(random() * 0x100000000)
        .toString(16)
        .padStart(8, '0'),
    ).join('');
  tab.setItem(ID, id);
  return { id, key: null, name: browser.getItem(NAME) ?? pageName(() => Number.parseInt(id.slice(0, 4), 16) / 0xffff || 0) };
}

/** To be called when the page goes: the next one in this tab is the same client. */
export function leave(tab: Memory): void {
  tab.setItem(LEFT, '1');
}

/** A person's own name for this browser's pages; empty takes the made-up one again. */
export function rename(who: Identity, name: string, browser: Memory): void {
  const own = name.trim().slice(0, LONGEST_NAME);
  if (own === '') browser.removeItem(NAME);
  else browser.setItem(NAME, own);
  who.name = own || pageName(() => Number.parseInt(who.id.slice(0, 4), 16) / 0xffff || 0);
}
