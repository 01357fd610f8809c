/**
 * This page's identity: a name for people, and an id that distinguishes this tab from every other tab.
 * The id stays the same until the tab is closed, also after a reload. A duplicated tab starts with a copy of the
 * original's id and must get a new id. A page stores a mark (`UNLOADED_KEY`) when it unloads; an id without this mark
 * belongs to a page that is still open.
 */

import { pageName } from '../api/client';

const ID_KEY = 'gcs.client-id';
const UNLOADED_KEY = 'gcs.left';
const NAME_KEY = 'gcs.client-name';
const MAX_NAME_LENGTH = 40;

export interface Identity {
  name: string;
  readonly id: string;
  /** The server's key for this client, derived from the id; null until the server has sent it. */
  key: string | null;
}

type KeyValueStorage = Pick<Storage, 'getItem' | 'setItem' | 'removeItem'>;

/**
 * A new id of 128 random bits that nobody can guess, as hexadecimal digits: who knows the id of a page has its control.
 * `crypto.getRandomValues` works on plain http too, unlike `crypto.randomUUID`.
 */
export function randomId(): string {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, '0')).join('');
}

/** The browser's storage; if it is disabled, values are kept until the page closes. */
export function availableStorage(getStorage: () => KeyValueStorage): KeyValueStorage {
  try {
    const storage = getStorage();
    storage.getItem(ID_KEY); // throws if storage is disabled
    return storage;
  } catch {
    const values = new Map<string, string>();
    return { getItem: (key) => values.get(key) ?? null, setItem: (key, value) => void values.set(key, value), removeItem: (key) => void values.delete(key) };
  }
}

/** The stored identity of this tab; a new identity if none is stored, or if the stored id belongs to another tab. */
export function loadIdentity(tabStorage: KeyValueStorage, browserStorage: KeyValueStorage, newId: () => string = randomId): Identity {
  const storedId = tabStorage.getItem(UNLOADED_KEY) === null ? null : tabStorage.getItem(ID_KEY);
  tabStorage.removeItem(UNLOADED_KEY);
  const id = storedId ?? newId();
  tabStorage.setItem(ID_KEY, id);
  return { id, key: null, name: chosenName(browserStorage) || defaultName(id) };
}

/** The name that the person has given in this browser; empty: none. */
export function chosenName(browserStorage: KeyValueStorage): string {
  return browserStorage.getItem(NAME_KEY) ?? '';
}

/** Called when the page unloads, so that the next page in this tab gets the same id. */
export function markUnloaded(tabStorage: KeyValueStorage): void {
  tabStorage.setItem(UNLOADED_KEY, '1');
}

/** Sets and stores the page's name for all pages of this browser; an empty name restores the default name. */
export function setName(identity: Identity, name: string, browserStorage: KeyValueStorage): void {
  const newName = name.trim().slice(0, MAX_NAME_LENGTH);
  if (newName === '') browserStorage.removeItem(NAME_KEY);
  else browserStorage.setItem(NAME_KEY, newName);
  identity.name = newName || defaultName(identity.id);
}

/** The page's name if the person has not chosen a name; stays the same when this tab is reloaded. */
function defaultName(id: string): string {
  return pageName(Number.parseInt(id.slice(0, 4), 16) || 0);
}
