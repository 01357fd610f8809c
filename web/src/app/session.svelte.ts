/** Wires the page's parts together: actions, the offboard stream it keeps alive, the gimbal it steers. */

import { Turns } from '../api/turns';
import { ActionController } from '../features/actions/controller.svelte';
import { ControlDesk } from '../features/control/control.svelte';
import { GimbalControl } from '../features/gimbal/control.svelte';
import { GroupDesk } from '../features/groups/groups.svelte';
import { OffboardControl } from '../features/offboard/control.svelte';
import { ReplayControl } from '../features/replay/replay.svelte';
import { room } from '../features/setpoints/room.svelte';
import { SpotMenu } from '../features/stage/spot.svelte';
import { stage } from '../features/stage/stage.svelte';
import { links } from '../features/topbar/links.svelte';
import { page } from './page.svelte';

const nowS = (): number => performance.now() / 1000;

const turns = new Turns();

const nameOf = (id: string): string => page.factsOf(id)?.name ?? `Vehicle ${id}`;

export const offboard = new OffboardControl(page.api, turns, nowS);

export const actions = new ActionController(page.api, nowS, (facts, wish) => offboard.start(facts, wish), (id) => page.factsOf(id));

export const groups = new GroupDesk(
  page.api, turns, actions, nowS, () => document.visibilityState === 'visible', nameOf,
  (id) => offboard.drop(id),
);

export const control = new ControlDesk(page.api, actions);

export const gimbal = new GimbalControl(page.api, actions);

export const spotMenu = new SpotMenu(page.api, actions, gimbal, nowS);

export const replay = new ReplayControl({
  api: page.api,
  replays: () => {
    void page.tick;
    return page.store.replays;
  },
  selectedId: () => page.selectedId,
  select: (id) => page.select(id),
});

export function start(): void {
  offboard.onAlone = (id) => groups.sentAlone(id);
  offboard.onNotRenewed = (id, problem) => {
    for (const place of ['offboard', 'room'] as const) actions.tell('Renewing the setpoint', nameOf(id), place, problem);
  };
  page.onTelemetry.push(() => offboard.tick((id) => page.streaming(id)));
  page.onTelemetry.push(() => groups.tick(page.connection));
  page.onTelemetry.push(() => replay.follow());
  page.onEvent.push((event) => actions.heard(event));
  page.onEvent.push((event) => control.heard(event));
  page.onEvent.push((event) => groups.heard(event));
  page.onPaint.push(() => actions.paint(page.selectedId));
  page.onEvent.push((event) => spotMenu.clickedIn3d(event, stage.token, stage.size, page.facts));
  page.onEvent.push((event) => {
    if (event.kind === 'scene_gizmo' && event['view'] === stage.token) room.onDrag?.(event);
  });
  links.poll(page.api);
  page.start();
}
