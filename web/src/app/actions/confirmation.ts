/**
 * State machine of a confirmation: asking, confirmed, expired, cancelled. A person confirms by moving the knob to the end of the
 * track with a pointer or arrow keys, or by holding Space or Enter. An open confirmation expires `EXPIRES_AFTER_S` after the last
 * input, and does not expire while a pointer holds the knob or a key is held. Callers pass the time.
 */

export const EXPIRES_AFTER_S = 5;
/** How long Space or Enter must be held to confirm [s]. */
export const KEY_HOLD_S = 0.8;
export const DANGER_KEY_HOLD_S = 1.5;
/** Number of arrow key presses from one end of the track to the other. */
export const KNOB_STEPS = 10;
/**
 * Longest interval between two calls of `updatePhase` that counts as holding [s]: during a longer pause the key may have been
 * released.
 */
const MAX_UPDATE_INTERVAL_S = 0.25;

export type Phase = 'asking' | 'confirmed' | 'expired' | 'cancelled';

export class ConfirmationSlider {
  phase: Phase = 'asking';
  /** Set while the typed value is not valid. */
  blocked = false;
  private deadline_s: number;
  /** Time of the last call of `updatePhase` while a key is held; null if no key is held. */
  private lastUpdate_s: number | null = null;
  private held_s = 0;
  /** Position of the knob, 0–1, set by a pointer or by arrow keys. */
  private knobPosition = 0;
  private isSliding = false;

  constructor(
    readonly danger: boolean,
    now_s: number,
  ) {
    this.deadline_s = now_s + EXPIRES_AFTER_S;
  }

  /** Progress of holding or sliding, 0–1. */
  progress(): number {
    return this.lastUpdate_s === null ? this.knobPosition : Math.min(1, this.held_s / this.holdTime_s());
  }

  /** Time until the confirmation expires; the full time while a pointer holds the knob or a key is held. */
  remaining_s(now_s: number): number {
    return this.isHeld() ? EXPIRES_AFTER_S : Math.max(0, this.deadline_s - now_s);
  }

  /** Space or Enter was pressed on the knob; the keyboard's repeats have no effect. */
  pressKey(now_s: number): void {
    if (this.blocked) this.restartExpiry(now_s);
    else if (this.phase === 'asking' && this.lastUpdate_s === null && !this.isSliding) {
      this.lastUpdate_s = now_s;
      this.held_s = 0;
    }
  }

  /** The key was released before the confirmation, or the knob lost the focus: the progress returns to zero. */
  releaseKey(now_s: number): void {
    this.lastUpdate_s = null;
    this.held_s = 0;
    this.releasePointer(now_s);
  }

  /** An arrow key moved the knob by this many steps. The knob stays there until it is moved again or loses the focus. */
  step(steps: number, now_s: number): void {
    this.restartExpiry(now_s);
    if (this.phase !== 'asking' || this.blocked || this.isSliding || this.lastUpdate_s !== null) return;
    this.knobPosition = Math.min(1, Math.max(0, Math.round(this.knobPosition * KNOB_STEPS + steps) / KNOB_STEPS));
    if (this.knobPosition >= 1) this.phase = 'confirmed';
  }

  /** A pointer holds the knob at `fraction` of the track; the end of the track confirms. */
  slide(fraction: number, now_s: number): void {
    if (this.blocked) this.restartExpiry(now_s);
    if (this.phase !== 'asking' || this.blocked || this.lastUpdate_s !== null) return;
    this.isSliding = true;
    this.knobPosition = Math.min(1, Math.max(0, fraction));
    if (this.knobPosition >= 1) this.phase = 'confirmed';
    this.restartExpiry(now_s);
  }

  /** The pointer released the knob: the knob returns to its start. */
  releasePointer(now_s: number): void {
    this.isSliding = false;
    this.knobPosition = 0;
    this.restartExpiry(now_s);
  }

  /** Called on input: the time until the confirmation expires starts again. */
  restartExpiry(now_s: number): void {
    this.deadline_s = now_s + EXPIRES_AFTER_S;
  }

  cancel(): void {
    if (this.phase === 'asking') this.phase = 'cancelled';
  }

  /** Called once per painted frame. @returns the present phase. */
  updatePhase(now_s: number): Phase {
    if (this.phase !== 'asking') return this.phase;
    if (this.lastUpdate_s !== null) {
      this.held_s += Math.min(MAX_UPDATE_INTERVAL_S, Math.max(0, now_s - this.lastUpdate_s));
      this.lastUpdate_s = now_s;
      if (this.held_s >= this.holdTime_s() - 1e-9) this.phase = 'confirmed';
    } else if (!this.isHeld() && now_s >= this.deadline_s) this.phase = 'expired';
    return this.phase;
  }

  private isHeld(): boolean {
    return this.lastUpdate_s !== null || this.isSliding;
  }

  private holdTime_s(): number {
    return this.danger ? DANGER_KEY_HOLD_S : KEY_HOLD_S;
  }
}
