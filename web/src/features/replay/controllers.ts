/** The page's only ReplayControl instance. */

import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import { ReplayControl } from './replay.svelte';

export const replay = new ReplayControl({
  api: page.api,
  replays: () => page.eachRepaint(() => page.store.replays),
  selectedId: () => page.selectedId,
  select: (id) => page.select(id),
  onOpened: () => registry.close('recordings'),
});
