import { commandGate } from '../../app/vehicle-actions.svelte';
import { VehicleFiles } from './files.svelte';

/** The page's only instance. */
export const vehicleFiles = new VehicleFiles(commandGate);
