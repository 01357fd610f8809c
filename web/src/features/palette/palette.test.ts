/** What the search of the page finds, and in which order. */

import { describe, expect, it, vi } from 'vitest';
import { stubBrowser } from '../../app/page.fixture';
import type { Found } from './palette';

stubBrowser();
vi.stubGlobal('matchMedia', () => ({ matches: false, addEventListener: () => undefined }));
const { registry } = await import('../../app/registry.svelte');
for (const load of Object.values(import.meta.glob('../*/register.ts'))) await load();
const { actionsOf, findablesOf, matching, MAX_FOUND, viewsOf } = await import('./palette');

const entry = (title: string, hint = '', group = 'Actions'): Found => ({ title, hint, group, run: () => undefined });
const titles = (all: readonly Found[], text: string): string[] => matching(all, text).map(({ title }) => title);

describe('the search of the page', () => {
  it('offers every action that has a key of its own, and every view', () => {
    const offered = actionsOf().map(({ title }) => title);
    for (const title of ['Hold: immediately, no confirmation', 'Take off', 'Land', 'Return', 'Arm or disarm', 'Stop motors: the vehicle falls'])
      expect(offered).toContain(title);
    expect(offered.filter((title) => title.startsWith('Select a vehicle'))).toEqual([]); // one of ten keys does not say which
    expect(viewsOf().map(({ title }) => title)).toEqual(['Fly', ...registry.rooms.map(({ title }) => title)]);
  });

  it('finds what contains all words, in any case, with the best first', () => {
    const all = [entry('Follow the land'), entry('Switch', 'Land'), entry('Land now'), entry('Island tour', '', 'Plans')];
    expect(titles(all, 'LAND')).toEqual(['Land now', 'Follow the land', 'Island tour', 'Switch']);
    expect(titles(all, 'tour plans')).toEqual(['Island tour']);
    expect(titles(all, 'landing')).toEqual([]);
  });

  it('shows a bounded number of rows of a long list', () => {
    const all = Array.from({ length: 1000 }, (_, i) => entry(`MPC_${i}`));
    expect(matching(all, '')).toHaveLength(MAX_FOUND);
    expect(matching(all, 'mpc')).toHaveLength(MAX_FOUND);
    expect(titles(all, 'mpc_999')).toEqual(['MPC_999']);
  });

  it('takes each feature’s entries when they are ready, and runs what was chosen', async () => {
    const run = vi.fn();
    registry.addFinder({ group: 'Test', order: 1, load: () => Promise.resolve(() => [{ title: 'A thing', hint: '', run }]) });
    const found: Found[] = [];
    vi.stubGlobal('fetch', () => Promise.reject(new TypeError('offline')));
    await findablesOf(null, (more) => found.push(...more));
    matching(found, 'a thing')[0]?.run();
    expect(run).toHaveBeenCalledOnce();
  });
});
