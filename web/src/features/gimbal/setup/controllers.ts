/** The only instance of the set-up. Apart from the gimbal's control, which is needed at the first load. */

import { page } from '../../../app/page.svelte';
import { ParamChanges } from '../../../app/param-changes/changes.svelte';
import { actions, commandGate } from '../../../app/vehicle-actions.svelte';
import { GimbalSetup } from './setup.svelte';

export const gimbalSetup = new GimbalSetup(page.api, actions, new ParamChanges(page.api, commandGate));
