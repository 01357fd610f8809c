/**
 * Says a setpoint again before it expires, as long as this page is open and hears the server: closing the page lets it
 * expire, and the server then does what `on_expiry` says. Ticked by arriving telemetry, which a hidden tab still gets.
 */

import { VALID_FOR_S, type PositionSetpoint } from './setpoint';

/** Part of the validity after which it is said again. */
const REFRESH_AT = 0.3;

export class SetpointKeeper {
  private kept: PositionSetpoint | null = null;
  private saidAt_s = 0;
  private busy = false;

  /** @param say sends the setpoint; resolves false where it was refused: then nothing is said again. */
  constructor(private readonly say: (setpoint: PositionSetpoint) => Promise<boolean>) {}

  get setpoint(): PositionSetpoint | null {
    return this.kept;
  }

  /** From now on this one is kept alive; the caller has just sent it. */
  keep(setpoint: PositionSetpoint, now_s: number): void {
    this.kept = setpoint;
    this.saidAt_s = now_s;
  }

  forget(): void {
    this.kept = null;
  }

  /** @param streaming whether the server still streams for this vehicle. */
  tick(now_s: number, streaming: boolean): void {
    if (this.kept === null || this.busy || now_s - this.saidAt_s < REFRESH_AT * VALID_FOR_S) return;
    if (!streaming) {
      this.forget();
      return;
    }
    const said = this.kept;
    this.busy = true;
    this.saidAt_s = now_s;
    void this.say(said).then((accepted) => {
      this.busy = false;
      if (!accepted && this.kept === said) this.forget();
    });
  }
}
