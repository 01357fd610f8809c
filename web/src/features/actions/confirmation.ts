/**
 * A confirmation as a state machine: asked, held or slid to its end, expired, cancelled. Time comes in with each call.
 * It expires after five seconds without a touch, never while a finger or the Space bar is on it.
 */

export const EXPIRES_AFTER_S = 5;
export const HOLD_S = 0.8;
export const HOLD_DANGER_S = 1.5;

export type Phase = 'asking' | 'confirmed' | 'expired' | 'cancelled';

export class Confirmation {
  phase: Phase = 'asking';
  /** What is asked is not valid as it stands: it cannot be confirmed until it is. */
  blocked = false;
  private deadline_s: number;
  private heldSince_s: number | null = null;
  private slid = 0;
  private sliding = false;

  constructor(readonly danger: boolean, now_s: number) {
    this.deadline_s = now_s + EXPIRES_AFTER_S;
  }

  /** How far it has been pressed or slid, 0–1. */
  progress(now_s: number): number {
    if (this.sliding) return this.slid;
    if (this.heldSince_s === null) return 0;
    return Math.min(1, (now_s - this.heldSince_s) / this.holdS());
  }

  left_s(now_s: number): number {
    return this.busy() ? EXPIRES_AFTER_S : Math.max(0, this.deadline_s - now_s);
  }

  /** Space went down; the keyboard's own repeats change nothing. */
  press(now_s: number): void {
    if (this.blocked) this.touch(now_s); // somebody is at it: there is time to put it right
    else if (this.phase === 'asking' && this.heldSince_s === null) this.heldSince_s = now_s;
  }

  release(now_s: number): void {
    this.tick(now_s);
    this.heldSince_s = null;
    this.touch(now_s);
  }

  /** The keyboard went elsewhere: what was held counts as nothing. */
  drop(now_s: number): void {
    if (this.heldSince_s === null) return;
    this.heldSince_s = null;
    this.touch(now_s);
  }

  /** The knob is at `fraction` of its way. Confirms only when let go or at its very end. */
  slide(fraction: number, now_s: number): void {
    if (this.blocked) this.touch(now_s);
    if (this.phase !== 'asking' || this.blocked) return;
    this.sliding = true;
    this.slid = Math.min(1, Math.max(0, fraction));
    if (this.slid >= 1) this.phase = 'confirmed';
    this.touch(now_s);
  }

  letGo(now_s: number): void {
    this.sliding = false;
    this.slid = 0;
    this.touch(now_s);
  }

  /** Someone changes a value in it: the five seconds start again. */
  touch(now_s: number): void {
    this.deadline_s = now_s + EXPIRES_AFTER_S;
  }

  cancel(): void {
    if (this.phase === 'asking') this.phase = 'cancelled';
  }

  tick(now_s: number): Phase {
    if (this.phase !== 'asking') return this.phase;
    if (this.heldSince_s !== null && now_s - this.heldSince_s >= this.holdS()) this.phase = 'confirmed';
    else if (!this.busy() && now_s >= this.deadline_s) this.phase = 'expired';
    return this.phase;
  }

  private busy(): boolean {
    return this.heldSince_s !== null || this.sliding;
  }

  private holdS(): number {
    return this.danger ? HOLD_DANGER_S : HOLD_S;
  }
}
