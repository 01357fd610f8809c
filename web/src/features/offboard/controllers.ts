/** The one stream control and the one group control of this page. */

import { page } from '../../app/page.svelte';
import { actions, nameOf, nowS, turns } from '../../app/session.svelte';
import { OffboardControl } from './control.svelte';
import { GroupController } from './groups/groups.svelte';

export const offboard = new OffboardControl(page.api, turns, nowS);

export const groups = new GroupController(
  page.api,
  turns,
  actions,
  nowS,
  () => document.visibilityState === 'visible',
  nameOf,
  (id) => offboard.drop(id),
);

offboard.onAlone = (id) => groups.sentAlone(id);
offboard.onNotRenewed = (id, problem) => {
  for (const place of ['offboard', 'room'] as const) actions.tell('Renewing the setpoint', nameOf(id), place, problem);
};
