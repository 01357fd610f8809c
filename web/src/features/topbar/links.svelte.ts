/** The station's links and warnings, asked for every few seconds: they change rarely and are no telemetry. */

import type { ApiClient } from '../../api/client';
import type { LinkLine, StationNotice } from './links';

const EVERY_MS = 3000;

class Links {
  list = $state.raw<LinkLine[]>([]);
  notices = $state.raw<StationNotice[]>([]);
  known = $state(false);

  poll(api: ApiClient): void {
    const ask = async (): Promise<void> => {
      const [links, warnings] = await Promise.all([
        api.get<{ links: LinkLine[] }>('/links'),
        api.get<{ warnings: StationNotice[] }>('/warnings'),
      ]);
      this.known = links.ok && warnings.ok;
      this.list = links.ok ? (links.value.links ?? []) : [];
      this.notices = warnings.ok ? (warnings.value.warnings ?? []) : [];
      setTimeout(() => void ask(), EVERY_MS);
    };
    void ask();
  }
}

export const links = new Links();
