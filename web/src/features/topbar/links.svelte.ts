/** The station's links and warnings, asked for every few seconds: they change rarely and are no telemetry. */

import type { ApiClient } from '../../api/client';
import type { LinkLine, StationNotice } from './links';

const EVERY_MS = 3000;

class Links {
  list = $state.raw<LinkLine[]>([]);
  notices = $state.raw<StationNotice[]>([]);
  known = $state(false);
  /** What comes in now [bytes/s]; null before two answers. */
  rate_bytes_s = $state<number | null>(null);
  private before: { bytes: number; at_ms: number } | null = null;

  poll(api: ApiClient): void {
    const ask = async (): Promise<void> => {
      const [links, warnings] = await Promise.all([
        api.get<{ links: LinkLine[] }>('/links'),
        api.get<{ warnings: StationNotice[] }>('/warnings'),
      ]);
      this.known = links.ok && warnings.ok;
      this.list = links.ok ? (links.value.links ?? []) : [];
      this.notices = warnings.ok ? (warnings.value.warnings ?? []) : [];
      this.measure();
      setTimeout(() => void ask(), EVERY_MS);
    };
    void ask();
  }

  private measure(): void {
    const now = { bytes: this.list.reduce((sum, l) => sum + l.bytes_received, 0), at_ms: performance.now() };
    const gain = this.before === null ? -1 : now.bytes - this.before.bytes;
    this.rate_bytes_s = this.before === null || gain < 0 ? null : (gain / (now.at_ms - this.before.at_ms)) * 1000;
    this.before = this.known ? now : null;
  }
}

export const links = new Links();
