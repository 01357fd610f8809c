import { commandGate } from '../../app/vehicle-actions.svelte';
import { ParamPanelState } from './panel.svelte';

/** The page's only ParamPanelState instance. */
export const paramPanel = new ParamPanelState(commandGate);
