/**
 * Ensures that a key pressed on one control never acts on another control.
 * For example, holding Space confirms and closes the confirmation, and another button gets the focus while Space is still down.
 * Without the guard, the repeats and the release of Space would press the other button.
 */

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
