import { page } from '../../app/page.svelte';
import { actions } from '../../app/vehicle-actions.svelte';
import { GuidedCommands } from './guided.svelte';

export const guided = new GuidedCommands(page.api, actions, (id) => page.factsNow(id));
