/**
 * A key that went down on one control acts on no other.
 *
 * A confirmation closes while the key that confirmed it is still down, and the focus goes back to another button: the
 * keyboard's repeats, and the release, would press that one.
 */

/** Keys that press the control that has the focus. */
const PRESSING: ReadonlySet<string> = new Set([' ', 'Enter']);

export interface PressedKey<T> {
  readonly key: string;
  readonly target: T | null;
  readonly repeat?: boolean;
}

export class KeyGuard<T = EventTarget> {
  private readonly pressedOn = new Map<string, T | null>();

  /** @param quiet whether a question has just closed by itself: a key that was meant for it, and comes too late, presses nothing. */
  constructor(private readonly quiet: () => boolean = () => false) {}

  /** A key went down; true: it must act on nothing. */
  down(event: PressedKey<T>): boolean {
    if (!PRESSING.has(event.key)) return false;
    if (event.repeat !== true && this.quiet()) {
      this.pressedOn.delete(event.key);
      return true;
    }
    if (event.repeat === true) return !this.pressedOn.has(event.key) || this.pressedOn.get(event.key) !== event.target;
    this.pressedOn.set(event.key, event.target);
    return false;
  }

  /** A key came up; true: it must act on nothing. */
  up(event: PressedKey<T>): boolean {
    if (!PRESSING.has(event.key)) return false;
    const same = this.pressedOn.has(event.key) && this.pressedOn.get(event.key) === event.target;
    this.pressedOn.delete(event.key);
    return !same;
  }

  /** The window lost the keyboard: what happens to the keys is not known any more. */
  clear(): void {
    this.pressedOn.clear();
  }
}
