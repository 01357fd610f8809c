/** The controllers of the plan room; the page has one instance of each. */

import { page } from '../../app/page.svelte';
import { availableStorage } from '../../app/identity';
import { actions, commandGate, nameOf } from '../../app/vehicle-actions.svelte';
import { AcceptedErrors } from './flight/accepted-errors.svelte';
import { RoleAssignment } from './flight/accepted-errors.svelte';
import type { PlannedHome } from './document/document';
import { PlanApi } from './api';
import { DryRun } from './dry-run/dry-run.svelte';
import { PlanEditor } from './editor/editor.svelte';
import { MissionInsertion } from './offboard/insertion.svelte';
import { VehicleMission } from './flight/vehicle-mission.svelte';
import { PatternDrawing } from './patterns/drawing.svelte';
import { SurveyDivision } from './patterns/division.svelte';
import { PatternUpdates } from './patterns/updates.svelte';
import { Plans } from './plans.svelte';

export const editor = new PlanEditor();
const planApi = new PlanApi(page.api);
const browserStorage = availableStorage(() => localStorage);
export const plans = new Plans(planApi, editor, browserStorage);
export const drawing = new PatternDrawing(planApi, editor, browserStorage);

export const patternUpdates = new PatternUpdates(planApi, editor);

export const insertion = new MissionInsertion(planApi, editor);

export const roleAssignment = new RoleAssignment();
export const division = new SurveyDivision(planApi, editor, roleAssignment);

export const vehicleMission = new VehicleMission(page.api, commandGate, (commandName, vehicle, problem) =>
  actions.showProblem(commandName, nameOf(vehicle), 'actionBar', problem),
);
export const dryRun = new DryRun(page.api);
// Registered for the whole page, because a dry run continues while another room is open.
page.eventListeners.push((event) => void dryRun.handleEvent(event));
export const acceptedErrors = new AcceptedErrors();

/** Home of the selected vehicle; null: home is not known, or the vehicle is a replay. */
export function vehicleHome(): PlannedHome | null {
  const home = page.facts === null || page.facts.replayed ? null : page.facts.home;
  return home === null ? null : { lat_deg: home.value.lat_deg, lon_deg: home.value.lon_deg, alt_amsl_m: home.value.alt_amsl_m };
}
