/** Whom a key belongs to: the page's single-key shortcuts, or the control that has the focus. Pure. */

/** What is read of the element that a key event goes to. */
export interface KeyTarget {
  readonly tagName?: string;
  /** Of an INPUT. */
  readonly type?: string;
  readonly readOnly?: boolean;
  readonly isContentEditable?: boolean;
  readonly tabIndex?: number;
  getAttribute?(name: string): string | null;
}

/** Input types without a text to type; every other type, also an unknown one, is a text field to browsers. */
const NOT_TYPED: ReadonlySet<string> = new Set(['checkbox', 'radio', 'range', 'button', 'submit', 'reset', 'image', 'file', 'color', 'hidden']);
const TEXT_ROLES: ReadonlySet<string> = new Set(['textbox', 'searchbox', 'combobox', 'spinbutton']);
/** Hold (also with Caps Lock), Land now, Stop motors: they come before a list's type-ahead. */
const SAFETY_KEYS: ReadonlySet<string> = new Set(['h', 'H', 'L', 'K']);

/** Whether characters are typed into it. */
export function takesText(target: KeyTarget | null): boolean {
  if (target === null) return false;
  if (target.isContentEditable === true) return true;
  const tag = target.tagName?.toUpperCase();
  if (tag === 'INPUT') return target.readOnly !== true && !NOT_TYPED.has((target.type ?? 'text').toLowerCase());
  if (tag === 'TEXTAREA') return target.readOnly !== true;
  return TEXT_ROLES.has(target.getAttribute?.('role') ?? '') && target.getAttribute?.('aria-readonly') !== 'true';
}

/** Whether a character moves its choice: a list of options goes to the next that begins with it. */
export function typesAhead(target: KeyTarget | null): boolean {
  return target?.tagName?.toUpperCase() === 'SELECT' || target?.getAttribute?.('role') === 'listbox';
}

/**
 * Whether a character pressed there is a shortcut of the page.
 *
 * @param key as the event says it, so capital with Shift.
 */
export function isShortcut(key: string, target: KeyTarget | null): boolean {
  if (takesText(target)) return false;
  return !typesAhead(target) || SAFETY_KEYS.has(key);
}

/** The character of a key; on a keyboard of another script the Latin letter that stands on the same key. */
export function characterOf(event: { readonly key: string; readonly code: string }): string {
  const letter = /^Key([A-Z])$/.exec(event.code)?.[1];
  if (letter === undefined || event.key.length !== 1 || event.key.charCodeAt(0) < 128) return event.key;
  return event.key === event.key.toLowerCase() ? letter.toLowerCase() : letter;
}

/** Whether it is a control: Space, Enter and arrows pressed there are its own. A panel that was only given the focus is none. */
export function isControl(target: KeyTarget | null): boolean {
  return target !== null && target.tagName?.toUpperCase() !== 'BODY' && (target.tabIndex ?? -1) >= 0;
}
