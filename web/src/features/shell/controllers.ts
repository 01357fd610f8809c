import { commandGate } from '../../app/vehicle-actions.svelte';
import { ShellPanelState } from './panel.svelte';

/** The page's only ShellPanelState instance. */
export const shellPanel = new ShellPanelState(commandGate);
