/** The page's only instance of the gimbal's control. */

import { page } from '../../app/page.svelte';
import { actions } from '../../app/vehicle-actions.svelte';
import { GimbalControl } from './control.svelte';

export const gimbalControl = new GimbalControl(page.api, actions);
