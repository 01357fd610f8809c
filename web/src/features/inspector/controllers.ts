import { page } from '../../app/page.svelte';
import { commandGate } from '../../app/vehicle-actions.svelte';
import { Inspector } from './inspector.svelte';
import { MessageForm } from './message-form.svelte';

/** The page's only instances. */
export const inspector = new Inspector(page.api);
export const messageForm = new MessageForm(commandGate);
