/** Links, recordings and what the station warns of (`GET /links`, `GET /warnings`), as words for the page. */

import type { components } from '../../api/schema';
import { duration, fixed, join, timeOfDay, UNKNOWN } from '../../ui/format';
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

/** Whether a link is being written to disk now. */
export function recordsNow(link: LinkLine): boolean {
  return link.recording !== null && link.recording.file !== null && link.recording.stopped === null;
}

function recordingLine(link: LinkLine): string {
  const file = link.recording;
  if (file === null) return 'not recorded';
  if (file.stopped !== null) return file.stopped;
  if (file.file === null) return 'begins with the first frame';
  return join([file.file, bytesText(file.bytes), file.started_unix_s === null ? null : `since ${timeOfDay(file.started_unix_s)}`]);
}

/** What is on disk of each link, as the station says it; the longest running file gives the time shown. */
export function recordingIndicator(links: readonly LinkLine[], known: boolean, now_unix_s: number): Indicator {
  const base = { label: 'Recording', word: '', severity: 'none' as const, stale: false, age_s: null };
  if (!known) return { ...base, text: UNKNOWN, details: [['', 'The station has not said yet.']] };
  const live = links.filter((l) => !l.replay && !l.forward);
  if (live.length === 0) {
    const why = links.some((l) => l.replay) ? 'A recording is replayed; nothing is recorded.' : 'No link is open that could be recorded.';
    return { ...base, text: 'None', details: [['', why]] };
  }
  const details = live.map((l): [string, string] => [l.name, recordingLine(l)]);
  if (live.some((l) => l.recording !== null && l.recording.stopped !== null)) {
    return { ...base, text: 'Stopped', word: 'not saved', severity: 'danger', details };
  }
  if (live.every((l) => l.recording === null)) return { ...base, text: 'Off', word: 'not saved', severity: 'caution', details };
  const began = live.filter(recordsNow).map((l) => l.recording?.started_unix_s ?? now_unix_s);
  return { ...base, text: began.length === 0 ? 'Waiting' : duration(Math.max(0, now_unix_s - Math.min(...began))), details };
}
