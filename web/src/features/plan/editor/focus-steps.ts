import { tick } from 'svelte';

/** Focuses the selected step in the list of steps; called when a form in place of this list closes. */
export async function focusSelectedStep(): Promise<void> {
  await tick();
  document.querySelector<HTMLElement>('[role=listbox] [role=option][tabindex="0"]')?.focus();
}
