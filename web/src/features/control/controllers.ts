/** The page's only ControlDesk instance. */

import { page } from '../../app/page.svelte';
import { actions } from '../../app/vehicle-actions.svelte';
import { ControlDesk } from './control.svelte';

export const control = new ControlDesk(page.api, actions);
