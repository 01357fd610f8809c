/** The page's only instances. */

import { page } from '../../app/page.svelte';
import { rooms } from '../../app/registry.svelte';
import { commandGate } from '../../app/vehicle-actions.svelte';
import { FlightLibrary } from './library.svelte';
import { LogView } from './log-view.svelte';
import { VehicleLogs } from './logs.svelte';

export const ROOM = 'flights';
export const library = new FlightLibrary(page.api);
export const view = new LogView(page.api);
export const vehicleLogs = new VehicleLogs(commandGate);

/** Opens a flight in the room. */
export function openFlight(id: string, name: string): Promise<void> {
  rooms.open(ROOM);
  return view.open(id, name);
}
