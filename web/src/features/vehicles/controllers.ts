import { commandGate } from '../../app/vehicle-actions.svelte';
import { VehicleList } from './list.svelte';

/** The page's only VehicleList instance. */
export const vehicleList = new VehicleList(commandGate);
