/**
 * Renews a group's setpoints before they expire, while this page is visible. If the page is hidden, suspended, closed or
 * disconnected, the setpoints expire, and the server switches all members to Hold. Arriving telemetry calls `renewIfDue`.
 */

import type { Validity } from '../../../vehicle/setpoint';
import { groupKey, type Group } from './group';

/** Fraction of the validity after which the setpoints are renewed. */
const RENEWAL_FRACTION = 0.3;

interface RenewedGroup {
  key: string;
  validity: Validity;
  sentAt_s: number;
  busy: boolean;
}

/** Result of a renewal; after `no answer` the renewer tries again. */
export type GroupRenewalResult = 'accepted' | 'refused' | 'no answer';

export class GroupRenewer {
  private current: RenewedGroup | null = null;

  /** @param send renews the setpoints of all members. */
  constructor(private readonly send: (group: Group, validity: Validity) => Promise<GroupRenewalResult>) {}

  /** Starts to renew this group if `validity.renew` is set. The caller has just sent the group's setpoints. */
  start(group: Group, validity: Validity, now_s: number): void {
    this.current = validity.renew ? { key: groupKey(group), validity, sentAt_s: now_s, busy: false } : null;
  }

  stop(): void {
    this.current = null;
  }

  isRenewing(group: Group): boolean {
    return this.current?.key === groupKey(group);
  }

  /**
   * @param groups all known groups.
   * @param isVisible whether the page is visible.
   */
  renewIfDue(now_s: number, groups: readonly Group[], isVisible: boolean): void {
    const current = this.current;
    if (current === null || current.busy) return;
    const group = groups.find((known) => groupKey(known) === current.key);
    if (group === undefined || group.state === 'ended' || group.state === 'holding') {
      this.stop(); // only a person may start the group again
      return;
    }
    if (group.state !== 'flying' || !isVisible || now_s - current.sentAt_s < RENEWAL_FRACTION * current.validity.valid_for_s) return;
    current.busy = true;
    current.sentAt_s = now_s;
    void this.send(group, current.validity).then((result) => {
      current.busy = false;
      if (result === 'refused' && this.current === current) this.stop();
    });
  }
}
