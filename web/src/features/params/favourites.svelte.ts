/** The parameters that a person has marked; the browser stores their names. */

const STORAGE_KEY = 'gcs-param-favourites';
const MAX_FAVOURITES = 200;
const NAME = /^[A-Za-z0-9_]{1,16}$/;

/** The names in a stored text; none if it is not a list of names. */
export function readFavourites(text: string | null): ReadonlySet<string> {
  try {
    const names: unknown = JSON.parse(text ?? '[]');
    if (!Array.isArray(names)) return new Set();
    return new Set(names.filter((name): name is string => typeof name === 'string' && NAME.test(name)).slice(0, MAX_FAVOURITES));
  } catch {
    return new Set(); // written by another version, or damaged
  }
}

function storedText(): string | null {
  try {
    return localStorage.getItem(STORAGE_KEY);
  } catch {
    return null; // storage is disabled
  }
}

class Favourites {
  names = $state.raw<ReadonlySet<string>>(readFavourites(storedText()));

  toggle(name: string): void {
    const names = new Set(this.names);
    if (!names.delete(name) && names.size < MAX_FAVOURITES) names.add(name);
    this.names = names;
    try {
      localStorage.setItem(STORAGE_KEY, JSON.stringify([...names]));
    } catch {
      // storage is disabled: the choice applies until the page closes
    }
  }
}

export const favourites = new Favourites();
