/** The page's only instances. */

import { page } from '../../app/page.svelte';
import { rooms } from '../../app/registry.svelte';
import { ReplayControl } from './replay.svelte';

export const replay = new ReplayControl({
  api: page.api,
  replays: () => page.eachRepaint(() => page.store.replays),
  selectedId: () => page.selectedId,
  select: (id) => page.select(id),
  onOpened: () => rooms.open('fly'),
});
