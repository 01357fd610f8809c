/** Links, recordings and what the station warns of (`GET /links`, `GET /warnings`), as words for the page. */

import type { components } from '../../api/schema';
import { fixed, join, UNKNOWN } from '../../ui/format';
import type { Indicator } from './indicators';

export type LinkLine = components['schemas']['Link'];
export type StationNotice = components['schemas']['Notice'];

const STATES: Readonly<Record<string, string>> = { connecting: 'connecting', open: 'open', waiting: 'waiting to try again', closed: 'closed', ended: 'replay ended' };

/** Bytes as a person reads them. */
export function bytesText(bytes: number): string {
  if (bytes < 1000) return `${bytes} B`;
  if (bytes < 999_500) return `${(bytes / 1000).toFixed(0)} kB`;
  return `${(bytes / 1e6).toFixed(1)} MB`;
}

/** @param rate_bytes_s what comes in now over all links; null before two answers. */
export function linkDetails(links: readonly LinkLine[], rate_bytes_s: number | null): { details: [string, string][]; text: string | null } {
  const details = links.map((l): [string, string] => [
    l.name,
    join([STATES[l.state] ?? l.state, l.peers.length === 0 ? null : l.peers.join(', '), `${bytesText(l.bytes_received)} in`,
      l.bytes_dropped > 0 ? `${bytesText(l.bytes_dropped)} not sent` : null, l.detail]),
  ]);
  const open = links.filter((l) => l.state === 'open' && !l.forward).length;
  const rate = rate_bytes_s === null ? null : `${fixed(rate_bytes_s / 1000, 1)} kB/s`;
  const text = open === 0 ? null : join([open === 1 ? null : `${open} links`, rate ?? 'open']);
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
