import { commandGate } from '../../app/vehicle-actions.svelte';
import { Inspector } from './inspector.svelte';
import { MessageForm } from './message-form.svelte';

/** The page's only instances. */
export const inspector = new Inspector();
export const messageForm = new MessageForm(commandGate);
