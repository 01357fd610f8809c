import { page } from '../../app/page.svelte';
import { actions } from '../../app/vehicle-actions.svelte';
import { ModeMenu } from './modes.svelte';

export const modeMenu = new ModeMenu(page.api, actions, (id) => page.factsNow(id));
