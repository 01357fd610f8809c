/** The page's only instances of OffboardControl and GroupController. */

import { page } from '../../app/page.svelte';
import { actions, commandGate, nameOf, nowS, commandQueue } from '../../app/vehicle-actions.svelte';
import { OffboardControl } from './control.svelte';
import { GroupController } from './groups/groups.svelte';

export const offboard = new OffboardControl(page.api, commandQueue, nowS, commandGate);

export const groups = new GroupController(
  page.api,
  commandQueue,
  actions,
  nowS,
  () => document.visibilityState === 'visible',
  nameOf,
  (id) => offboard.stopRenewing(id),
);

offboard.onVehicleSetpoint = (id) => {
  groups.onVehicleSetpoint(id);
  for (const listener of page.setpointListeners) listener(id);
};
offboard.onRenewalRefused = (id, problem) => {
  for (const pagePart of ['offboard', 'offboardRoom'] as const) actions.showProblem('Renewing the setpoint', nameOf(id), pagePart, problem);
};
