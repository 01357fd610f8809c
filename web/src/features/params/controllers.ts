/** The page's only instances of the parameter panel's state and of its changes. */

import { page } from '../../app/page.svelte';
import { ParamChanges } from '../../app/param-changes/changes.svelte';
import { commandGate } from '../../app/vehicle-actions.svelte';
import { ParamPanelState } from './panel.svelte';

export const paramPanel = new ParamPanelState(commandGate);
export const paramChanges = new ParamChanges(page.api, commandGate);
