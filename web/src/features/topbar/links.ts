/** Links, recordings and what the station warns of (`GET /links`, `GET /warnings`), as words for the page. */

import { join, UNKNOWN } from '../../ui/format';
import type { Indicator } from './indicators';

export interface LinkLine {
  name: string;
  url: string;
  /** connecting, open, waiting, closed, ended. */
  state: string;
  detail: string;
  replay: boolean;
  forward: boolean;
  peers: string[];
  bytes_received: number;
  bytes_dropped: number;
}

export interface StationNotice {
  kind: string;
  text: string;
  link: string | null;
  vehicle: string | null;
}

const STATES: Readonly<Record<string, string>> = { connecting: 'connecting', open: 'open', waiting: 'waiting to try again', closed: 'closed', ended: 'replay ended' };

/** Bytes as a person reads them. */
export function bytesText(bytes: number): string {
  if (bytes < 1000) return `${bytes} B`;
  if (bytes < 999_500) return `${(bytes / 1000).toFixed(0)} kB`;
  return `${(bytes / 1e6).toFixed(1)} MB`;
}

export function linkDetails(links: readonly LinkLine[]): { details: [string, string][]; text: string | null } {
  const details = links.map((l): [string, string] => [
    l.name,
    join([STATES[l.state] ?? l.state, l.peers.length === 0 ? null : l.peers.join(', '), `${bytesText(l.bytes_received)} in`,
      l.bytes_dropped > 0 ? `${bytesText(l.bytes_dropped)} not sent` : null, l.detail]),
  ]);
  const open = links.filter((l) => l.state === 'open' && !l.forward);
  const text = open.length === 0 ? null : open.length === 1 ? (open[0]?.url.split(':')[0] ?? null) : `${open.length} links`;
  return { details, text };
}

/** Every link that is no replay is recorded unless the station warns of it. */
export function recordingIndicator(links: readonly LinkLine[], notices: readonly StationNotice[], known: boolean): Indicator {
  const base = { label: 'Recording', word: '', severity: 'none' as const, stale: false, age_s: null };
  const recorded = links.filter((l) => !l.replay);
  if (!known) return { ...base, text: UNKNOWN, details: [['', 'The station has not said yet.']] };
  const stopped = notices.filter((n) => n.kind === 'recording');
  if (stopped.length > 0) {
    return { ...base, text: 'Stopped', word: 'not saved', severity: 'danger', details: stopped.map((n): [string, string] => [n.link ?? '', n.text]) };
  }
  if (recorded.length === 0) return { ...base, text: 'None', details: [['', 'Only recordings are replayed; nothing is recorded.']] };
  const flowing = recorded.some((l) => l.bytes_received > 0);
  const details = recorded.map((l): [string, string] => [l.name, l.bytes_received > 0 ? 'every frame, both ways' : 'begins with the first frame']);
  return { ...base, text: flowing ? 'On' : 'Waiting', details };
}
