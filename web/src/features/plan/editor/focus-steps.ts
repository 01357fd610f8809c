import { tick } from 'svelte';

/** Focuses the selected step of the list, which is shown again when a form in its place closes. */
export async function focusSteps(): Promise<void> {
  await tick();
  document.querySelector<HTMLElement>('[role=listbox] [role=option][tabindex="0"]')?.focus();
}
