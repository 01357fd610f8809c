/** The page's only instances. */

import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import { commandGate } from '../../app/vehicle-actions.svelte';
import { VehicleLogs } from './logs.svelte';
import { ReplayControl } from './replay.svelte';

export const replay = new ReplayControl({
  api: page.api,
  replays: () => page.eachRepaint(() => page.store.replays),
  selectedId: () => page.selectedId,
  select: (id) => page.select(id),
  onOpened: () => registry.close('recordings'),
});

export const vehicleLogs = new VehicleLogs(commandGate);
