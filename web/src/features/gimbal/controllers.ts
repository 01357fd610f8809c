/** The page's only instances of the gimbal's control and set-up. */

import { page } from '../../app/page.svelte';
import { ParamChanges } from '../../app/param-changes/changes.svelte';
import { actions, commandGate } from '../../app/vehicle-actions.svelte';
import { GimbalControl } from './control.svelte';
import { GimbalSetup } from './setup/setup.svelte';

export const gimbalControl = new GimbalControl(page.api, actions);
export const gimbalSetup = new GimbalSetup(page.api, actions, new ParamChanges(page.api, commandGate));
