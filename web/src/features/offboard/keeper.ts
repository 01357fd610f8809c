/**
 * Says a setpoint again before it expires, as long as this page is open and hears the server: closing the page lets it
 * expire, and the server then does what `on_expiry` says. Ticked by arriving telemetry, which a hidden tab still gets.
 * What has expired is not brought back: that is for a person to order.
 */

import type { AnySetpoint, Lasting } from '../../vehicle/setpoint';

/** Part of the validity after which it is said again. */
const REFRESH_AT = 0.3;

export interface Kept {
  setpoint: AnySetpoint;
  lasting: Lasting;
}

/** What came of saying it again: taken, refused for good, or neither, so that it is tried again. */
export type Said = 'taken' | 'refused' | 'not now';

export class SetpointKeeper {
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
   * From now on this one is kept alive, if it shall be; the caller is just sending it.
   * @returns what to call if it is refused: the vehicle then flies on as before, so that is kept alive again.
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
