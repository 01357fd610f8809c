/** Shared by all features: the vehicle actions, and the queue of commands for each vehicle. */

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

export const actions = new ActionController(
  page.api,
  nowS,
  (facts, streamStart) => service('offboard').start(facts, streamStart),
  (id) => page.factsOf(id),
  commandGate,
  () => page.selectedId,
);

registry.addCloser({ order: 0, isOpen: () => actions.confirmation !== null, close: () => actions.cancelConfirmation() });
registry.addCloser({ order: 100, isOpen: () => true, close: () => actions.dismissRefusal('actionBar') });
page.eventListeners.push((event) => actions.handleEvent(event));
page.paintListeners.push(() => actions.onFrame(page.selectedId));
