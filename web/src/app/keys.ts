/**
 * The keyboard: one table, shown by the `?` sheet and obeyed here; also for keys pressed inside the 3D view.
 *
 * Space and Enter are in no table: they belong to the control that has the focus (`ui/Slide.svelte` confirms by them).
 */

import { sheet } from '../features/help/sheet.svelte';
import { choice } from '../features/instruments/choice.svelte';
import { panel } from '../features/messages/panel.svelte';
import { params } from '../features/params/panel.svelte';
import { readiness } from '../features/readiness/panel.svelte';
import { room } from '../features/setpoints/room.svelte';
import { stage } from '../features/stage/stage.svelte';
import { KeyGuard } from './key-guard';
import { characterOf, isShortcut, type KeyTarget } from './key-targets';
import { page } from './page.svelte';
import { actions, control, replay, spotMenu } from './session.svelte';
import { shortcuts } from './shortcuts.svelte';
import { theme } from './theme.svelte';

export interface KeyLine {
  keys: string;
  what: string;
  /** Also obeyed while the 3D view has the keyboard (it moves its camera by W A S D Q E). */
  inScene: boolean;
}

export const KEYS: readonly KeyLine[] = [
  { keys: 'H', what: 'Hold: at once, no confirmation', inScene: true },
  { keys: 'T', what: 'Take off', inScene: true },
  { keys: 'L', what: 'Land', inScene: true },
  { keys: 'R', what: 'Return', inScene: true },
  { keys: 'Shift L', what: 'Land now, whoever has control', inScene: false },
  { keys: 'C', what: 'Who has control: take it, ask for it, release it', inScene: true },
  { keys: 'G', what: 'Give control to who asks for it; Shift G keeps it', inScene: false },
  { keys: 'Shift A', what: 'Arm or disarm', inScene: false },
  { keys: 'Shift K', what: 'Stop motors: the vehicle falls', inScene: false },
  { keys: 'Space held', what: 'Confirm what is asked, on its slider', inScene: true },
  { keys: 'Esc', what: 'Cancel, close', inScene: true },
  { keys: 'O', what: 'Start offboard where it is', inScene: true },
  { keys: 'P', what: 'Offboard room: setpoints, plots, gamepad', inScene: true },
  { keys: 'Y', what: 'Why it cannot arm or fly a mode', inScene: true },
  { keys: 'I', what: 'Parameters: search, read, set', inScene: true },
  { keys: 'N', what: 'All messages, or the newest few', inScene: true },
  { keys: 'V', what: 'Choose the values shown', inScene: true },
  { keys: 'M', what: 'Swap map and 3D', inScene: true },
  { keys: 'F', what: 'Map follows the vehicle, or stays', inScene: true },
  { keys: 'Z', what: 'Map close to the vehicle', inScene: true },
  { keys: 'U', what: 'Map north up', inScene: true },
  { keys: '1 … 9', what: 'Choose a vehicle; 0 is the tenth', inScene: true },
  { keys: 'Shift D', what: 'Light or dark', inScene: false },
  { keys: 'Space', what: 'Replay: play or pause', inScene: false },
  { keys: '← →', what: 'Replay: 5 s back or on, 30 s with Shift', inScene: false },
  { keys: '?', what: 'This sheet', inScene: true },
];

function plain(key: string): boolean {
  const facts = page.facts;
  switch (key) {
    case 'h': actions.request('hold', facts); return true;
    case 't': actions.request('takeoff', facts); return true;
    case 'l': actions.request('land', facts); return true;
    case 'r': actions.request('rtl', facts); return true;
    case 'o': actions.request('offboard_start', facts, 'offboard'); return true;
    case 'p': room.toggle(); return true;
    case 'c': return control.toggle();
    case 'g': return control.answer(facts, true);
    case 'm': stage.swap(); return true;
    case 'f': stage.map?.follow(); return true;
    case 'z': stage.map?.near(); return true;
    case 'u': stage.map?.northUp(); return true;
    case 'i': params.toggle(); return true;
    case 'y': readiness.toggle(); return true;
    case 'n': panel.open = !panel.open; return true;
    case 'v': choice.editing = !choice.editing; return true;
    default: return false;
  }
}

function shifted(key: string): boolean {
  const facts = page.facts;
  switch (key) {
    case 'A': actions.request(facts?.status?.value.armed === true ? 'disarm' : 'arm', facts); return true;
    case 'L': actions.request('land_now', facts); return true;
    case 'G': return control.answer(facts, false);
    case 'K': actions.request('kill', facts); return true;
    case 'D': theme.toggle(); return true;
    default: return false;
  }
}

function escape(): boolean {
  if (actions.asked !== null) actions.cancel();
  else if (sheet.open) sheet.open = false;
  else if (readiness.open) readiness.close();
  else if (params.open) params.close();
  else if (replay.listOpen) replay.listOpen = false;
  else if (control.open) control.open = false;
  else if (choice.editing) choice.editing = false;
  else if (spotMenu.spot !== null) spotMenu.close();
  else actions.dismiss('bar');
  return true;
}

function choose(digit: string): boolean {
  const id = page.ids[(Number(digit) + 9) % 10];
  if (id !== undefined) page.select(id);
  return id !== undefined;
}

function obey(event: KeyboardEvent): boolean {
  if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return false;
  if (event.key === 'Escape') return event.repeat || escape();
  const key = characterOf(event);
  if (event.repeat || !shortcuts.on || !isShortcut(key, event.target as KeyTarget | null)) return false;
  if (key === '?') {
    sheet.open = !sheet.open;
    return true;
  }
  if (/^[0-9]$/.test(key)) return choose(key);
  return event.shiftKey ? shifted(key.toUpperCase()) : plain(key.toLowerCase());
}

/** Obeys the keys of a window (the page's, or the 3D view's) until the returned function is called. */
export function listenToKeys(on: Window): () => void {
  const inScene = on !== window;
  const guard = new KeyGuard(() => actions.hasJustClosed());
  const stop = (event: KeyboardEvent): void => {
    event.preventDefault();
    event.stopImmediatePropagation();
  };
  // Before any control sees it: what is pressed on one acts on no other.
  const first = (event: KeyboardEvent): void => {
    if (guard.down(event)) stop(event);
  };
  const up = (event: KeyboardEvent): void => {
    if (guard.up(event)) event.preventDefault(); // no stop: a control that waits for the release still hears of it
  };
  const down = (event: KeyboardEvent): void => {
    if (inScene && /^[wasdqe]$/i.test(event.key)) return; // the 3D view's own
    if (obey(event)) event.preventDefault();
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
