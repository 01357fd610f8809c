/**
 * Renews a setpoint before it expires, as long as this page is open and connected: closing the page lets it
 * expire, and the server then does what `on_expiry` says. Ticked by arriving telemetry, which a hidden tab still gets.
 * An expired setpoint is not sent again: only a person may do that.
 */

import type { AnySetpoint, Lasting } from '../../vehicle/setpoint';

/** Fraction of the validity after which it is renewed. */
const REFRESH_AT = 0.3;

export interface Kept {
  setpoint: AnySetpoint;
  lasting: Lasting;
}

/** Result of a renewal: taken, refused, or neither, so that it is tried again. */
export type Said = 'taken' | 'refused' | 'not now';

export class SetpointRenewer {
  private kept: Kept | null = null;
  private saidAt_s = 0;
  private takenAt_s = 0;
  private busy = false;

  /** @param say sends the setpoint. */
  constructor(private readonly say: (kept: Kept) => Promise<Said>) {}

  get setpoint(): AnySetpoint | null {
    return this.kept?.setpoint ?? null;
  }

  /**
   * Starts to renew this setpoint, if that was chosen; the caller is sending it now.
   * @returns a function to call if it is refused: the vehicle keeps its previous setpoint, which is then renewed again.
   */
  keep(setpoint: AnySetpoint, lasting: Lasting, now_s: number): () => void {
    const [before, beforeSaidAt_s, beforeTakenAt_s] = [this.kept, this.saidAt_s, this.takenAt_s];
    const mine = { setpoint, lasting };
    this.kept = mine;
    this.saidAt_s = this.takenAt_s = now_s;
    return () => {
      if (this.kept !== mine) return;
      this.kept = before;
      this.saidAt_s = beforeSaidAt_s;
      this.takenAt_s = beforeTakenAt_s;
    };
  }

  forget(): void {
    this.kept = null;
  }

  /** @param streaming whether the server still streams for this vehicle. */
  tick(now_s: number, streaming: boolean): void {
    const kept = this.kept;
    if (kept === null || this.busy || now_s - this.saidAt_s < REFRESH_AT * kept.lasting.valid_for_s) return;
    if (!streaming || !kept.lasting.renew || now_s - this.takenAt_s >= kept.lasting.valid_for_s) {
      this.forget();
      return;
    }
    this.busy = true;
    this.saidAt_s = now_s;
    void this.say(kept).then((said) => {
      this.busy = false;
      if (this.kept !== kept) return;
      if (said === 'refused') this.forget();
      else if (said === 'taken') this.takenAt_s = now_s;
    });
  }
}
