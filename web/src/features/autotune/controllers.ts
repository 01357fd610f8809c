import { page } from '../../app/page.svelte';
import { ParamChanges } from '../../app/param-changes/changes.svelte';
import { actions, commandGate } from '../../app/vehicle-actions.svelte';
import { AutotuneControl } from './autotune.svelte';

export const autotune = new AutotuneControl(page.api, actions, (id) => page.factsNow(id), new ParamChanges(page.api, commandGate));
