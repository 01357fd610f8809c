/** Decides whether a key is a shortcut of the page or input for the focused control. Pure functions. */

/** The properties read from a key event's target element. */
export interface KeyTarget {
  readonly tagName?: string;
  /** Type of an INPUT element. */
  readonly type?: string;
  readonly readOnly?: boolean;
  readonly isContentEditable?: boolean;
  readonly tabIndex?: number;
  getAttribute?(name: string): string | null;
}

/** Types of INPUT elements that take no typed characters; a type that is unknown to the browser is a text field. */
const NON_TEXT_TYPES: ReadonlySet<string> = new Set(['checkbox', 'radio', 'range', 'button', 'submit', 'reset', 'image', 'file', 'color', 'hidden']);
const TEXT_ROLES: ReadonlySet<string> = new Set(['textbox', 'searchbox', 'combobox', 'spinbutton']);
const TYPE_AHEAD_ROLES: ReadonlySet<string> = new Set(['listbox', 'menu', 'menuitem']);
/** Keys of Hold (also with Caps Lock), Land now and Stop motors: they override a list's type-ahead. */
const SAFETY_KEYS: ReadonlySet<string> = new Set(['h', 'H', 'L', 'K']);

/** Whether the element takes typed characters. */
export function takesText(target: KeyTarget | null): boolean {
  if (target === null) return false;
  if (target.isContentEditable === true) return true;
  const tag = target.tagName?.toUpperCase();
  if (tag === 'INPUT') return target.readOnly !== true && !NON_TEXT_TYPES.has((target.type ?? 'text').toLowerCase());
  if (tag === 'TEXTAREA') return target.readOnly !== true;
  if (tag === 'BUTTON') return false; // also with the role `combobox`: the button opens a list
  return TEXT_ROLES.has(target.getAttribute?.('role') ?? '') && target.getAttribute?.('aria-readonly') !== 'true';
}

/** Whether the control has type-ahead: a character selects the next option or menu item that begins with it. */
export function hasTypeAhead(target: KeyTarget | null): boolean {
  const attribute = (name: string): string => target?.getAttribute?.(name) ?? '';
  if (target?.tagName?.toUpperCase() === 'SELECT' || TYPE_AHEAD_ROLES.has(attribute('role'))) return true;
  // The button of an open list keeps the focus; the button of a menu keeps it until the menu has opened.
  return ['menu', 'listbox'].includes(attribute('aria-haspopup')) && attribute('aria-expanded') === 'true';
}

/**
 * Whether a character pressed on the element is a shortcut of the page.
 * @param key the event's `key`; a capital letter with Shift.
 */
export function isShortcut(key: string, target: KeyTarget | null): boolean {
  if (takesText(target)) return false;
  return !hasTypeAhead(target) || SAFETY_KEYS.has(key);
}

/** The character of a key; for a non-Latin character, the Latin letter of the same physical key. */
export function characterOf(event: { readonly key: string; readonly code: string }): string {
  const letter = /^Key([A-Z])$/.exec(event.code)?.[1];
  if (letter === undefined || event.key.length !== 1 || event.key.charCodeAt(0) < 128) return event.key;
  return event.key === event.key.toLowerCase() ? letter.toLowerCase() : letter;
}

/**
 * Whether a held Space or Enter repeats on the element: only where it types a character. A held key presses a button, or submits
 * a form, once.
 */
export function mayRepeat(key: string, target: KeyTarget | null): boolean {
  if (key !== ' ' && key !== 'Enter') return true;
  return takesText(target) && (key === ' ' || target?.tagName?.toUpperCase() !== 'INPUT');
}

/** Whether the element is a control, which handles Space, Enter and arrows itself. A focused panel is not a control. */
export function isControl(target: KeyTarget | null): boolean {
  return target !== null && target.tagName?.toUpperCase() !== 'BODY' && (target.tabIndex ?? -1) >= 0;
}

/** Keys that press the focused control. */
const PRESS_KEYS: ReadonlySet<string> = new Set([' ', 'Enter']);

export interface PressedKey<T> {
  readonly key: string;
  readonly target: T | null;
  readonly repeat?: boolean;
}

export class KeyGuard<T = EventTarget> {
  private readonly pressedTargets = new Map<string, T | null>();

  /** @param confirmationJustClosed whether a confirmation has just closed without a key press: a key press that comes too late must have no effect. */
  constructor(private readonly confirmationJustClosed: () => boolean = () => false) {}

  /** A key was pressed. @returns true: the page must ignore the event. */
  blocksKeyDown(event: PressedKey<T>): boolean {
    if (!PRESS_KEYS.has(event.key)) return false;
    if (event.repeat !== true && this.confirmationJustClosed()) {
      this.pressedTargets.delete(event.key);
      return true;
    }
    if (event.repeat === true) return !this.pressedTargets.has(event.key) || this.pressedTargets.get(event.key) !== event.target;
    this.pressedTargets.set(event.key, event.target);
    return false;
  }

  /** A key was released. @returns true: the page must ignore the event. */
  blocksKeyUp(event: PressedKey<T>): boolean {
    if (!PRESS_KEYS.has(event.key)) return false;
    const isSameControl = this.pressedTargets.has(event.key) && this.pressedTargets.get(event.key) === event.target;
    this.pressedTargets.delete(event.key);
    return !isSameControl;
  }

  /** The window lost the focus: the state of the keys is no longer known. */
  clear(): void {
    this.pressedTargets.clear();
  }
}
