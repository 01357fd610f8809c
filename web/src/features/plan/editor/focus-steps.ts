import { tick } from 'svelte';

/** Focuses the selected step when a form that replaced the list of steps closes. */
export async function focusSteps(): Promise<void> {
  await tick();
  document.querySelector<HTMLElement>('[role=listbox] [role=option][tabindex="0"]')?.focus();
}
