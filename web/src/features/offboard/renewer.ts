/**
 * Renews a setpoint before it expires, as long as this page is open and connected. If the page is closed, the
 * setpoint expires and the server executes `on_expiry`. Arriving telemetry calls `renewIfDue`, also in a hidden tab. The
 * renewer never sends an expired setpoint again: only a person may do that.
 */

import type { AnySetpoint, Validity } from '../../vehicle/setpoint';

/** Fraction of the validity after which the setpoint is renewed. */
const RENEWAL_FRACTION = 0.3;

export interface RenewedSetpoint {
  setpoint: AnySetpoint;
  validity: Validity;
}

/** Result of a renewal; after `retry` the renewer tries again. */
export type RenewalResult = 'accepted' | 'refused' | 'retry';

export class SetpointRenewer {
  private current: RenewedSetpoint | null = null;
  private sentAt_s = 0;
  private acceptedAt_s = 0;
  private busy = false;

  constructor(private readonly send: (renewed: RenewedSetpoint) => Promise<RenewalResult>) {}

  get setpoint(): AnySetpoint | null {
    return this.current?.setpoint ?? null;
  }

  /**
   * Starts to renew this setpoint if `validity.renew` is set; the caller is sending the setpoint now.
   * @returns a function to call if the server refuses the setpoint: the renewer then renews the previous setpoint, which the vehicle still follows.
   */
  start(setpoint: AnySetpoint, validity: Validity, now_s: number): () => void {
    const [previous, previousSentAt_s, previousAcceptedAt_s] = [this.current, this.sentAt_s, this.acceptedAt_s];
    const newSetpoint = { setpoint, validity };
    this.current = newSetpoint;
    this.sentAt_s = this.acceptedAt_s = now_s;
    return () => {
      if (this.current !== newSetpoint) return;
      this.current = previous;
      this.sentAt_s = previousSentAt_s;
      this.acceptedAt_s = previousAcceptedAt_s;
    };
  }

  stop(): void {
    this.current = null;
  }

  /** @param isStreaming whether the server still streams to the vehicle. */
  renewIfDue(now_s: number, isStreaming: boolean): void {
    const current = this.current;
    if (current === null || this.busy || now_s - this.sentAt_s < RENEWAL_FRACTION * current.validity.valid_for_s) return;
    if (!isStreaming || !current.validity.renew || now_s - this.acceptedAt_s >= current.validity.valid_for_s) {
      this.stop();
      return;
    }
    this.busy = true;
    this.sentAt_s = now_s;
    void this.send(current).then((result) => {
      this.busy = false;
      if (this.current !== current) return;
      if (result === 'refused') this.stop();
      else if (result === 'accepted') this.acceptedAt_s = now_s;
    });
  }
}
