/** The page's only ControlController instance. */

import { page } from '../../app/page.svelte';
import { actions } from '../../app/vehicle-actions.svelte';
import { ControlController } from './control.svelte';

export const control = new ControlController(page.api, actions);
