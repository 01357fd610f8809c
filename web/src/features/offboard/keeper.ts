/**
 * Says a setpoint again before it expires, as long as this page is open and hears the server: closing the page lets it
 * expire, and the server then does what `on_expiry` says. Ticked by arriving telemetry, which a hidden tab still gets.
 */

import type { AnySetpoint, Lasting } from './setpoint';

/** Part of the validity after which it is said again. */
const REFRESH_AT = 0.3;

export interface Kept {
  setpoint: AnySetpoint;
  lasting: Lasting;
}

export class SetpointKeeper {
  private kept: Kept | null = null;
  private saidAt_s = 0;
  private busy = false;

  /** @param say sends the setpoint; resolves false where it was refused: then nothing is said again. */
  constructor(private readonly say: (kept: Kept) => Promise<boolean>) {}

  get setpoint(): AnySetpoint | null {
    return this.kept?.setpoint ?? null;
  }

  /** From now on this one is kept alive, if it shall be; the caller has just sent it. */
  keep(setpoint: AnySetpoint, lasting: Lasting, now_s: number): void {
    this.kept = { setpoint, lasting };
    this.saidAt_s = now_s;
  }

  forget(): void {
    this.kept = null;
  }

  /** @param streaming whether the server still streams for this vehicle. */
  tick(now_s: number, streaming: boolean): void {
    const said = this.kept;
    if (said === null || this.busy || now_s - this.saidAt_s < REFRESH_AT * said.lasting.valid_for_s) return;
    if (!streaming || !said.lasting.renew) {
      this.forget();
      return;
    }
    this.busy = true;
    this.saidAt_s = now_s;
    void this.say(said).then((accepted) => {
      this.busy = false;
      if (!accepted && this.kept === said) this.forget();
    });
  }
}
