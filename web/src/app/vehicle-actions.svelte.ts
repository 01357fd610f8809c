/** Shared by all features: the vehicle actions, and the queue of commands for each vehicle. */

import type { components } from '../api/schema';
import { CommandQueue } from '../api/command-queue';
import { CommandGate } from './actions/command.svelte';
import { ActionController } from './actions/controller.svelte';
import { page } from './page.svelte';
import { registry } from './registry.svelte';
import { service } from './services';

export const nowS = (): number => performance.now() / 1000;

export const commandQueue = new CommandQueue();

/** Sends each command of this page once, and only to the vehicles for which it was given. */
export const commandGate = new CommandGate((id) => page.identify(id), nowS);

export const nameOf = (id: string): string => page.factsOf(id)?.name ?? `Vehicle ${id}`;

/** What the server's findings before a flight depend on: mode and state of a vehicle, its mission and the mission's current item. */
function stateOf(id: string): string {
  const [facts, vehicle] = [page.factsNow(id), page.store.vehicles.get(id)];
  const mission = vehicle?.readAs<components['schemas']['Mission']>('mission', page.store.nowUnixS())?.value;
  return JSON.stringify([facts?.status?.value.mode, facts?.status?.value.armed, facts?.inAir, mission?.mission_id, mission?.current]);
}

export const actions = new ActionController(
  page.api,
  nowS,
  (facts, streamStart) => service('offboard').start(facts, streamStart),
  (id) => page.factsOf(id),
  commandGate,
  () => page.selectedId,
  stateOf,
);

registry.addCloser({ order: 0, isOpen: () => actions.confirmation !== null, close: () => actions.cancelConfirmation() });
registry.addCloser({ order: 100, isOpen: () => true, close: () => actions.dismissRefusal('actionBar') });
page.eventListeners.push((event) => actions.handleEvent(event));
page.paintListeners.push(() => actions.onFrame(page.selectedId));
