/** The page's only instances. */

import { ParamChanges } from '../../app/param-changes/changes.svelte';
import { page } from '../../app/page.svelte';
import { rooms } from '../../app/registry.svelte';
import { LiveView, stateOf, type State } from '../../plots/live-view.svelte';
import { commandGate } from '../../app/vehicle-actions.svelte';
import { AfterLanding } from './after-landing.svelte';
import { FlightLibrary, titleOf, type Row } from './library.svelte';
import { Identification } from './identification.svelte';
import { LogView } from './log-view.svelte';
import { TwoFlights } from './two-flights.svelte';
import { WhatIf } from './what-if.svelte';
import { Tuning } from './tuning.svelte';
import { GainProof } from './gain-proof.svelte';
import { Values } from './values.svelte';
import { ParamCompare } from './param-compare.svelte';
import { VehicleLogs } from './logs.svelte';
import { plotsShown } from './plots-shown.svelte';

export const ROOM = 'flights';
export const library = new FlightLibrary(page.api);
export const view = new LogView(page.api);
export const live = new LiveView(page.api);
export const whatIf = new WhatIf(page.api, view);
export const tuning = new Tuning(page.api, view);
export const gainProof = new GainProof(page.api);
export const identification = new Identification(page.api, view);
export const twoFlights = new TwoFlights(page.api, view);
export const values = new Values(page.api, view, (url) => {
  const link = document.createElement('a');
  link.href = url;
  link.download = '';
  link.click();
});
export const paramCompare = new ParamCompare(page.api);
export const paramChanges = new ParamChanges(page.api, commandGate);
export const vehicleLogs = new VehicleLogs(commandGate);
export const afterLanding = new AfterLanding(page.api, commandGate);

/** Shows what arrives of a vehicle. @param panes their fields, as of a telemetry log. */
export function openLive(vehicle: string, name: string, panes?: readonly (readonly string[])[]): void {
  rooms.open(ROOM);
  view.close();
  live.open(vehicle, name, panes);
  plotsShown.isOpen = true;
}

/** What the bands of the live plots show now. */
export function liveState(): State | null {
  return live.vehicle === null ? null : stateOf(page.factsNow(live.vehicle));
}

/** Shows the list of flights again. */
export function closeShown(): void {
  live.close();
  view.close();
}

/** Opens a flight, or a file without one. */
export function openRow(row: Row): Promise<void> {
  rooms.open(ROOM);
  live.close();
  whatIf.reset();
  tuning.reset();
  twoFlights.reset();
  identification.reset();
  values.reset();
  return view.open(row.files[0]?.id ?? row.id, titleOf(row), row.flight);
}

/** Opens a log, and the flight of which it is a part, if that is the only one in it. */
export async function openFlight(id: string, name: string): Promise<void> {
  rooms.open(ROOM);
  live.close();
  whatIf.reset();
  tuning.reset();
  twoFlights.reset();
  identification.reset();
  values.reset();
  if (!(await view.read(id, name))) return;
  await library.load(); // which flights a log has is known once it was read
  if (view.id !== id) return;
  const [row, ...others] = library.rows.filter(({ flight, files }) => flight !== null && files.some((file) => file.id === id));
  await (row !== undefined && others.length === 0 ? openRow(row) : view.open(id, name));
}
