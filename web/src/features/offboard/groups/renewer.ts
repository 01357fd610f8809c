/**
 * Renews a group's setpoints before they expire, while this page is visible: hidden, asleep, closed or disconnected, it
 * lets them expire, and the server puts all into Hold. Ticked by arriving telemetry.
 */

import type { Lasting } from '../../../vehicle/setpoint';
import { keyOf, type Group } from './group';

/** Part of the validity after which it is renewed. */
const REFRESH_AT = 0.3;

interface Kept {
  key: string;
  lasting: Lasting;
  saidAt_s: number;
  busy: boolean;
}

/** Result of a renewal: taken, refused, or without an answer, so that it is tried again. */
export type Said = 'taken' | 'refused' | 'unheard';

export class GroupRenewer {
  private kept: Kept | null = null;

  /** @param say renews the setpoints of all members. */
  constructor(private readonly say: (group: Group, lasting: Lasting) => Promise<Said>) {}

  /** Starts to renew this group, if that was chosen; the caller has just sent its setpoints. */
  keep(group: Group, lasting: Lasting, now_s: number): void {
    this.kept = lasting.renew ? { key: keyOf(group), lasting, saidAt_s: now_s, busy: false } : null;
  }

  forget(): void {
    this.kept = null;
  }

  keeps(group: Group): boolean {
    return this.kept?.key === keyOf(group);
  }

  /**
   * @param groups all known groups.
   * @param seen whether somebody can see the page.
   */
  tick(now_s: number, groups: readonly Group[], seen: boolean): void {
    const kept = this.kept;
    if (kept === null || kept.busy) return;
    const group = groups.find((one) => keyOf(one) === kept.key);
    if (group === undefined || group.state === 'ended' || group.state === 'holding') {
      this.forget(); // ended or being stopped: only a person may start it again
      return;
    }
    if (group.state !== 'flying' || !seen || now_s - kept.saidAt_s < REFRESH_AT * kept.lasting.valid_for_s) return;
    kept.busy = true;
    kept.saidAt_s = now_s;
    void this.say(group, kept.lasting).then((said) => {
      kept.busy = false;
      if (said === 'refused' && this.kept === kept) this.forget();
    });
  }
}
