/** The server's links and warnings. They are not part of the telemetry, so the page polls them. */

import type { ApiClient } from '../../api/client';
import { lossPercent, type ServerLink, type ServerNotice } from './links';

const POLL_INTERVAL_MS = 3000;
/** Number of polls over which packet loss is measured: half a minute. */
const LOSS_POLLS = 10;

class Links {
  list = $state.raw<readonly ServerLink[]>([]);
  notices = $state.raw<readonly ServerNotice[]>([]);
  /** Whether the server responded to the last poll: links and warnings are known. */
  isKnown = $state(false);
  /** Received data rate; null until two polls had a response. */
  rate_bytes_s = $state<number | null>(null);
  /** Packet loss of the last half minute; null: no packets received. */
  lost_percent = $state<number | null>(null);
  private lastBytes: { count: number; at_ms: number } | null = null;
  private readonly packetCounts: { received: number; lost: number }[] = [];

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
    const bytes = { count: this.list.reduce((sum, l) => sum + l.bytes_received, 0), at_ms: performance.now() };
    const received = this.lastBytes === null ? -1 : bytes.count - this.lastBytes.count;
    this.rate_bytes_s = this.lastBytes === null || received < 0 ? null : (received / (bytes.at_ms - this.lastBytes.at_ms)) * 1000;
    this.lastBytes = this.isKnown ? bytes : null;
    this.measureLoss();
  }

  private measureLoss(): void {
    const vehicleLinks = this.list.filter((l) => !l.forward);
    const count = { received: vehicleLinks.reduce((sum, l) => sum + l.frames_received, 0), lost: vehicleLinks.reduce((sum, l) => sum + l.frames_lost, 0) };
    const previousCount = this.packetCounts.at(-1);
    // After a restart of the server, or when a link is closed, the counters decrease.
    if (!this.isKnown || (previousCount !== undefined && count.received < previousCount.received)) this.packetCounts.length = 0;
    if (!this.isKnown) return;
    this.packetCounts.push(count);
    if (this.packetCounts.length > LOSS_POLLS) this.packetCounts.shift();
    this.lost_percent = lossPercent(this.packetCounts[0] ?? count, count);
  }
}

export const links = new Links();
