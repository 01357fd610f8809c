/**
 * This page's identity: a name for people, and an id that distinguishes this tab from every other tab.
 * The id stays the same until the tab is closed, also after a reload. A duplicated tab starts with a copy of the
 * original's id and must get a new id. A page sets a mark (`UNLOADED`) when it unloads: an id without this mark
 * belongs to a page that is still open.
 */

import { pageName } from '../api/client';

const ID = 'gcs.client-id';
const UNLOADED = 'gcs.left';
const NAME = 'gcs.client-name';
const MAX_NAME_LENGTH = 40;

export interface Identity {
  name: string;
  readonly id: string;
  /** The server's key for this client, derived from the id; null until the server has sent it. */
  key: string | null;
}

type KeyValueStorage = Pick<Storage, 'getItem' | 'setItem' | 'removeItem'>;

/** The browser's storage; if it is disabled, values are kept until the page closes. */
export function availableStorage(storage: () => KeyValueStorage): KeyValueStorage {
  try {
    const available = storage();
    available.getItem(ID); // throws if storage is disabled
    return available;
  } catch {
    const values = new Map<string, string>();
    return { getItem: (key) => values.get(key) ?? null, setItem: (key, value) => void values.set(key, value), removeItem: (key) => void values.delete(key) };
  }
}

/** The stored identity of this tab; a new identity if none is stored, or if the stored id belongs to another tab. */
export function loadIdentity(tab: KeyValueStorage, browser: KeyValueStorage, random: () => number = Math.random): Identity {
  const known = tab.getItem(UNLOADED) === null ? null : tab.getItem(ID);
  tab.removeItem(UNLOADED);
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

/** Called when the page unloads, so that the next page in this tab is the same client. */
export function markUnloaded(tab: KeyValueStorage): void {
  tab.setItem(UNLOADED, '1');
}

/** Sets the person's name for this browser's pages; empty restores the default name. */
export function rename(identity: Identity, name: string, browser: KeyValueStorage): void {
  const chosen = name.trim().slice(0, MAX_NAME_LENGTH);
  if (chosen === '') browser.removeItem(NAME);
  else browser.setItem(NAME, chosen);
  identity.name = chosen || pageName(() => Number.parseInt(identity.id.slice(0, 4), 16) / 0xffff || 0);
}
