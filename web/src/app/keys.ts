/**
 * Handles the keyboard shortcuts that features register, also for keys pressed inside the 3D view. The `?` sheet lists
 * the shortcuts.
 * Space and Enter are not shortcuts: they belong to the focused control (`ui/Slide.svelte` uses them to confirm).
 */

import { KeyGuard } from './key-targets';
import { characterOf, isShortcut, mayRepeat, type KeyTarget } from './key-targets';
import { page } from './page.svelte';
import { registry } from './registry.svelte';
import { actions } from './vehicle-actions.svelte';
import { shortcuts } from './shortcuts.svelte';
import { theme } from './theme.svelte';

registry.addKeys([
  { order: 110, keys: 'Space held', description: 'On the focused slider: confirm', inScene: true },
  { order: 120, keys: 'Esc', description: 'Cancel, close', inScene: true },
  { order: 230, keys: 'Shift D', description: 'Light or dark theme', inScene: false, handlers: { 'Shift D': () => theme.toggle() } },
]);

function closeTopmost(): boolean {
  registry.closers.find((closer) => closer.isOpen())?.close();
  return true;
}

/** A key's name in the registry: `h`, `Shift L`, `?`, `7`. */
function nameOfKey(key: string, shift: boolean): string {
  if (!/^[a-z]$/i.test(key)) return key;
  return shift ? `Shift ${key.toUpperCase()}` : key.toLowerCase();
}

function handleShortcut(event: KeyboardEvent): boolean {
  if (event.altKey || event.defaultPrevented) return false;
  const key = characterOf(event);
  if (event.ctrlKey || event.metaKey) return !event.repeat && !event.shiftKey && handle(`Ctrl ${key.toUpperCase()}`);
  if (event.key === 'Escape') return event.repeat || closeTopmost();
  if (event.repeat || !shortcuts.enabled || !isShortcut(key, event.target as KeyTarget | null)) return false;
  return handle(nameOfKey(key, event.shiftKey));
}

/** Runs the handler of a key. @returns false: the key has none, or had no effect. */
function handle(name: string): boolean {
  const handler = registry.keys.find((line) => line.handlers !== undefined && name in line.handlers)?.handlers?.[name];
  return handler !== undefined && handler(page.facts) !== false;
}

/** Handles the keys of a window (the page's or the 3D view's) until the returned function is called. */
export function listenToKeys(target: Window): () => void {
  const inScene = target !== window;
  const guard = new KeyGuard(() => actions.confirmationJustClosed());
  const stop = (event: KeyboardEvent): void => {
    event.preventDefault();
    event.stopImmediatePropagation();
  };
  // Runs before any control handles the event: a key pressed on one control must not act on another control.
  const guardDown = (event: KeyboardEvent): void => {
    const isHeldDown = event.repeat && !mayRepeat(event.key, event.target as KeyTarget | null);
    if (guard.blocksKeyDown(event) || isHeldDown) stop(event);
  };
  const guardUp = (event: KeyboardEvent): void => {
    if (guard.blocksKeyUp(event)) event.preventDefault(); // not stopped: a control that waits for the key's release still gets the event
  };
  const handleDown = (event: KeyboardEvent): void => {
    if (inScene && /^[wasdqe]$/i.test(event.key)) return; // these keys move the 3D view's camera
    if (handleShortcut(event)) event.preventDefault();
  };
  const clearGuard = (): void => guard.clear();
  target.addEventListener('keydown', guardDown, true);
  target.addEventListener('keyup', guardUp, true);
  target.addEventListener('keydown', handleDown);
  target.addEventListener('blur', clearGuard);
  return () => {
    target.removeEventListener('keydown', guardDown, true);
    target.removeEventListener('keyup', guardUp, true);
    target.removeEventListener('keydown', handleDown);
    target.removeEventListener('blur', clearGuard);
  };
}
