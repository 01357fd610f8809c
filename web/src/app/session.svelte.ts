/** Wires the page's parts together: actions, the offboard stream it keeps alive, the gimbal it steers. */

import { ActionController } from '../features/actions/controller.svelte';
import { GimbalControl } from '../features/gimbal/control.svelte';
import { OffboardControl } from '../features/offboard/control.svelte';
import { links } from '../features/topbar/links.svelte';
import { page } from './page.svelte';

const nowS = (): number => performance.now() / 1000;

export const offboard = new OffboardControl(page.api, nowS);

export const actions = new ActionController(page.api, nowS, (facts) => offboard.start(facts), (id) => page.factsOf(id));

export const gimbal = new GimbalControl(page.api, actions);

export function start(): void {
  page.onTelemetry.push(() => offboard.tick((id) => page.streaming(id)));
  page.onEvent.push((event) => actions.heard(event));
  page.onPaint.push(() => actions.paint(page.selectedId));
  links.poll(page.api);
  page.start();
}
