/** The server's links and warnings. They are not part of the telemetry, so the page polls them. */

import type { ApiClient } from '../../api/client';
import { lossPercent, type ServerLink, type ServerNotice } from './links';

const POLL_INTERVAL_MS = 3000;
/** Number of polls over which packet loss is measured: half a minute. */
const LOSS_POLLS = 10;

class Links {
  list = $state.raw<readonly ServerLink[]>([]);
  notices = $state.raw<readonly ServerNotice[]>([]);
  /** Whether the server has responded to the last poll. */
  isKnown = $state(false);
  /** Received data rate; null until two polls had a response. */
  rate_bytes_s = $state<number | null>(null);
  /** Packet loss of the last half minute; null: no packets received. */
  lost_percent = $state<number | null>(null);
  private lastCount: { bytes: number; at_ms: number } | null = null;
  private readonly counts: { received: number; lost: number }[] = [];

  poll(api: ApiClient): void {
    const request = async (): Promise<void> => {
      const [links, warnings] = await Promise.all([api.get('/links'), api.get('/warnings')]);
      this.isKnown = links.ok && warnings.ok;
      this.list = links.ok ? (links.value.links ?? []) : [];
      this.notices = warnings.ok ? (warnings.value.warnings ?? []) : [];
      this.measureRateAndLoss();
      setTimeout(() => void request(), POLL_INTERVAL_MS);
    };
    void request();
  }

  private measureRateAndLoss(): void {
    const now = { bytes: this.list.reduce((sum, l) => sum + l.bytes_received, 0), at_ms: performance.now() };
    const received = this.lastCount === null ? -1 : now.bytes - this.lastCount.bytes;
    this.rate_bytes_s = this.lastCount === null || received < 0 ? null : (received / (now.at_ms - this.lastCount.at_ms)) * 1000;
    this.lastCount = this.isKnown ? now : null;
    this.measureLoss();
  }

  private measureLoss(): void {
    const vehicleLinks = this.list.filter((l) => !l.forward);
    const now = { received: vehicleLinks.reduce((sum, l) => sum + l.frames_received, 0), lost: vehicleLinks.reduce((sum, l) => sum + l.frames_lost, 0) };
    const last = this.counts.at(-1);
    // After a restart of the server, or when a link is closed, the counters decrease.
    if (!this.isKnown || (last !== undefined && now.received < last.received)) this.counts.length = 0;
    if (!this.isKnown) return;
    this.counts.push(now);
    if (this.counts.length > LOSS_POLLS) this.counts.shift();
    this.lost_percent = lossPercent(this.counts[0] ?? now, now);
  }
}

export const links = new Links();
