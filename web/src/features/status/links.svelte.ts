/** The server's links and warnings, polled every few seconds, because they are not part of the telemetry. */

import type { ApiClient } from '../../api/client';
import { lossPercent, type LinkLine, type StationNotice } from './links';

const POLL_INTERVAL_MS = 3000;
/** Number of answers over which packet loss is measured: half a minute. */
const LOSS_ANSWERS = 10;

class Links {
  list = $state.raw<readonly LinkLine[]>([]);
  notices = $state.raw<readonly StationNotice[]>([]);
  known = $state(false);
  /** Received data rate; null until the server has answered twice. */
  rate_bytes_s = $state<number | null>(null);
  /** Recent packet loss; null if no packets came. */
  lost_percent = $state<number | null>(null);
  private before: { bytes: number; at_ms: number } | null = null;
  private readonly counts: { received: number; lost: number }[] = [];

  poll(api: ApiClient): void {
    const ask = async (): Promise<void> => {
      const [links, warnings] = await Promise.all([api.get('/links'), api.get('/warnings')]);
      this.known = links.ok && warnings.ok;
      this.list = links.ok ? (links.value.links ?? []) : [];
      this.notices = warnings.ok ? (warnings.value.warnings ?? []) : [];
      this.measure();
      setTimeout(() => void ask(), POLL_INTERVAL_MS);
    };
    void ask();
  }

  private measure(): void {
    const now = { bytes: this.list.reduce((sum, l) => sum + l.bytes_received, 0), at_ms: performance.now() };
    const gain = this.before === null ? -1 : now.bytes - this.before.bytes;
    this.rate_bytes_s = this.before === null || gain < 0 ? null : (gain / (now.at_ms - this.before.at_ms)) * 1000;
    this.before = this.known ? now : null;
    this.countLoss();
  }

  private countLoss(): void {
    const live = this.list.filter((l) => !l.forward);
    const now = { received: live.reduce((sum, l) => sum + l.frames_received, 0), lost: live.reduce((sum, l) => sum + l.frames_lost, 0) };
    const last = this.counts.at(-1);
    // Another server or a closed link: its counters start again from zero.
    if (!this.known || (last !== undefined && now.received < last.received)) this.counts.length = 0;
    if (!this.known) return;
    this.counts.push(now);
    if (this.counts.length > LOSS_ANSWERS) this.counts.shift();
    this.lost_percent = lossPercent(this.counts[0] ?? now, now);
  }
}

export const links = new Links();
