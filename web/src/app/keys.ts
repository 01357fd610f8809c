/**
 * Keyboard shortcuts: features register them, the `?` sheet lists them, and this module handles them, also for keys
 * pressed inside the 3D view.
 * Space and Enter are not shortcuts: they belong to the focused control (`ui/Slide.svelte` uses them to confirm).
 */

import { KeyGuard } from './key-guard';
import { characterOf, isShortcut, type KeyTarget } from './key-targets';
import { page } from './page.svelte';
import { registry } from './registry.svelte';
import { actions } from './vehicle-actions.svelte';
import { shortcuts } from './shortcuts.svelte';
import { theme } from './theme.svelte';

registry.addKeys([
  { order: 110, keys: 'Space held', what: 'Confirm, while the slider of the confirmation is focused', inScene: true },
  { order: 120, keys: 'Esc', what: 'Cancel, close', inScene: true },
  { order: 230, keys: 'Shift D', what: 'Light or dark theme', inScene: false, on: { 'Shift D': () => theme.toggle() } },
]);

function closeTopmost(): boolean {
  registry.closers.find((closer) => closer.isOpen())?.close();
  return true;
}

/** The name that shortcut lines use: `h`, `Shift L`, `?`, `7`. */
function nameOfKey(key: string, shift: boolean): string {
  if (!/^[a-z]$/i.test(key)) return key;
  return shift ? `Shift ${key.toUpperCase()}` : key.toLowerCase();
}

function handleShortcut(event: KeyboardEvent): boolean {
  if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return false;
  if (event.key === 'Escape') return event.repeat || closeTopmost();
  const key = characterOf(event);
  if (event.repeat || !shortcuts.on || !isShortcut(key, event.target as KeyTarget | null)) return false;
  const name = nameOfKey(key, event.shiftKey);
  const act = registry.keys.find((line) => line.on !== undefined && name in line.on)?.on?.[name];
  return act !== undefined && act(page.facts) !== false;
}

/** Handles the keys of a window (the page's or the 3D view's) until the returned function is called. */
export function listenToKeys(on: Window): () => void {
  const inScene = on !== window;
  const guard = new KeyGuard(() => actions.hasJustClosed());
  const stop = (event: KeyboardEvent): void => {
    event.preventDefault();
    event.stopImmediatePropagation();
  };
  // Runs before any control: a key pressed on one control must not act on another.
  const first = (event: KeyboardEvent): void => {
    if (guard.down(event)) stop(event);
  };
  const up = (event: KeyboardEvent): void => {
    if (guard.up(event)) event.preventDefault(); // not stopped: a control that waits for the release still gets the event
  };
  const down = (event: KeyboardEvent): void => {
    if (inScene && /^[wasdqe]$/i.test(event.key)) return; // otherwise the 3D view handles it
    if (handleShortcut(event)) event.preventDefault();
  };
  const blur = (): void => guard.clear();
  on.addEventListener('keydown', first, true);
  on.addEventListener('keyup', up, true);
  on.addEventListener('keydown', down);
  on.addEventListener('blur', blur);
  return () => {
    on.removeEventListener('keydown', first, true);
    on.removeEventListener('keyup', up, true);
    on.removeEventListener('keydown', down);
    on.removeEventListener('blur', blur);
  };
}
