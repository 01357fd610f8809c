import { commandGate } from '../../app/vehicle-actions.svelte';
import { ReadinessPanel } from './panel.svelte';

/** The page's only ReadinessPanel instance. */
export const readinessPanel = new ReadinessPanel(commandGate);
