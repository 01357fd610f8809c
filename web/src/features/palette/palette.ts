/** What the search of the page finds: everything that features have registered, best first. */

import { registry, rooms, type Findable } from '../../app/registry.svelte';
import { page } from '../../app/page.svelte';
import type { VehicleFacts } from '../../vehicle/facts';

/** Maximum number of rows. */
export const MAX_FOUND = 40;

export interface Found extends Findable {
  readonly group: string;
}

/** The keys of the keyboard sheet that do one thing, as actions. */
export function actionsOf(): Found[] {
  return registry.keys.flatMap(({ keys, description, handlers }) => {
    const [handler, ...others] = Object.values(handlers ?? {});
    if (handler === undefined || others.length > 0 || keys === PALETTE_KEYS) return [];
    return [{ group: 'Actions', title: description, hint: '', keys, run: () => handler(page.facts) }];
  });
}

/** Keys of the search itself. */
export const PALETTE_KEYS = 'Ctrl K';

/** The rooms of the page. */
export function viewsOf(): Found[] {
  const fly = { id: 'fly', title: 'Fly', hint: 'Map, 3D view and instruments' };
  return [fly, ...registry.rooms].map(({ id, title, hint }) => ({ group: 'Views', title, hint, run: () => rooms.open(id) }));
}

/** Reads what the features' finders offer, group by group as each is ready. */
export async function findablesOf(facts: VehicleFacts | null, take: (found: readonly Found[]) => void): Promise<void> {
  await Promise.all(
    registry.finders.map(async ({ group, load }) => {
      const find = await load();
      take((await find(facts)).map((each) => ({ ...each, group })));
    }),
  );
}

/**
 * The entries that contain all typed words, those first whose title begins with the text, then those with a word of the title
 * that begins with it; with no text those of the page itself.
 */
export function matching(all: readonly Found[], text: string): readonly Found[] {
  const words = text
    .toLowerCase()
    .split(/\s+/)
    .filter((word) => word !== '');
  if (words.length === 0) return all.slice(0, MAX_FOUND);
  const start = words.join(' ');
  const rank = ({ title }: Found): number => {
    const lower = title.toLowerCase();
    if (lower.startsWith(start)) return 0;
    if (` ${lower}`.includes(` ${start}`)) return 1;
    return words.every((word) => lower.includes(word)) ? 2 : 3;
  };
  const found = all.filter(({ title, hint, group }) => {
    const searched = `${title} ${hint} ${group}`.toLowerCase();
    return words.every((word) => searched.includes(word));
  });
  return found
    .map((entry) => ({ entry, rank: rank(entry) }))
    .sort((a, b) => a.rank - b.rank)
    .slice(0, MAX_FOUND)
    .map(({ entry }) => entry);
}
