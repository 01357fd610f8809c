/** Links, recordings and warnings of the server (`GET /links`, `GET /warnings`) as texts. */

import type { components } from '../../api/schema';
import { duration, fixed, join, timeOfDay, UNKNOWN } from '../../ui/format';
import type { Indicator } from './indicators';

export type LinkLine = components['schemas']['Link'];
export type StationNotice = components['schemas']['Notice'];

const STATES: Readonly<Record<string, string>> = {
  connecting: 'connecting',
  open: 'open',
  waiting: 'waiting to try again',
  closed: 'closed',
  ended: 'replay ended',
};

/** A number of bytes as text. */
function bytesText(bytes: number): string {
  if (bytes < 1000) return `${bytes} B`;
  if (bytes < 999_500) return `${(bytes / 1000).toFixed(0)} kB`;
  return `${(bytes / 1e6).toFixed(1)} MB`;
}

/** Packet loss between two counts [%]; null if no packets came in between. */
export function lossPercent(from: { received: number; lost: number }, to: { received: number; lost: number }): number | null {
  const lost = Math.max(0, to.lost - from.lost);
  const all = to.received - from.received + lost;
  return all <= 0 ? null : (lost / all) * 100;
}

/** Packet loss since the link was opened, from gaps in the sequence numbers, as text. */
function lossText(link: LinkLine): string {
  const all = link.frames_received + link.frames_lost;
  return all === 0 ? UNKNOWN : `${fixed((link.frames_lost / all) * 100, 1)} %`;
}

/** Number of peers that are listed; the others are counted. */
const PEERS_SHOWN = 4;

function peersText(peers: readonly string[]): string {
  if (peers.length === 0) return UNKNOWN;
  const more = peers.length - PEERS_SHOWN;
  return [...peers.slice(0, PEERS_SHOWN), ...(more > 0 ? [`and ${more} more`] : [])].join('\n');
}

/** One line for each counter of a link. */
function linkLines(link: LinkLine, several: boolean): [string, string][] {
  const lines: [string, string][] = several ? [['', link.name]] : [['Link', link.name]];
  lines.push(
    ['State', join([STATES[link.state] ?? link.state, link.detail])],
    ['Peers', peersText(link.peers)],
    ['Frames', `${link.frames_received} in, ${link.frames_lost} lost (${lossText(link)})`],
    ['CRC errors', String(link.crc_errors)],
    ['Bytes', join([`${bytesText(link.bytes_received)} in`, `${bytesText(link.bytes_sent)} out`])],
  );
  if (link.signing !== null) lines.push(['Signing', `key ${link.signing.key}, ${link.signing.mode}; ${link.frames_refused} frames refused`]);
  if (link.frames_unverified > 0) lines.push(['Not verified', `${link.frames_unverified} signed frames (this link has no key)`]);
  if (link.frames_unknown > 0) lines.push(['Unknown frames', String(link.frames_unknown)]);
  if (link.bytes_skipped > 0) lines.push(['Not MAVLink', `${bytesText(link.bytes_skipped)} skipped`]);
  if (link.handler_errors > 0) lines.push(['Server faults', `${link.handler_errors} messages skipped (see the server’s log)`]);
  if (link.frames_waiting > 0) lines.push(['Waiting to be sent', `${link.frames_waiting} frames`]);
  if (link.frames_expired > 0) lines.push(['Expired in the queue', `${link.frames_expired} frames`]);
  if (link.bytes_dropped > 0) lines.push(['Dropped', `${bytesText(link.bytes_dropped)} (queue full or no peer)`]);
  return lines;
}

/**
 * @param rate_bytes_s received data rate of all links; null until the server has answered twice.
 * @param lost_percent packet loss of the last half minute; null if no packets came.
 */
export function linkDetails(
  links: readonly LinkLine[],
  rate_bytes_s: number | null,
  lost_percent: number | null = null,
): { details: [string, string][]; text: string | null } {
  const details = links.flatMap((link) => linkLines(link, links.length > 1));
  const open = links.filter((l) => l.state === 'open' && !l.forward).length;
  const rate = rate_bytes_s === null ? null : `${fixed(rate_bytes_s / 1000, 1)} kB/s`;
  const text =
    open === 0
      ? null
      : join([
          open === 1 ? null : `${open} links`,
          rate ?? 'open',
          lost_percent === null ? null : `${fixed(lost_percent, lost_percent > 0 && lost_percent < 9.95 ? 1 : 0)} % lost`,
        ]);
  return { details, text };
}

/** Whether a link is being recorded now. */
export function isRecording(link: LinkLine): boolean {
  return link.recording !== null && link.recording.file !== null && link.recording.stopped === null;
}

function recordingLine(link: LinkLine): string {
  const file = link.recording;
  if (file === null) return 'not recorded';
  if (file.stopped !== null) return file.stopped;
  if (file.file === null) return 'starts with the first frame';
  return join([file.file, bytesText(file.bytes), file.started_unix_s === null ? null : `since ${timeOfDay(file.started_unix_s)}`]);
}

/** State of the recordings; the longest running one gives the time shown. */
export function recordingIndicator(links: readonly LinkLine[], known: boolean, now_unix_s: number): Indicator {
  const base = { label: 'Recording', word: '', severity: 'none' as const, stale: false, age_s: null };
  if (!known) return { ...base, text: UNKNOWN, details: [['', 'Not reported by the server yet.']] };
  const live = links.filter((l) => !l.replay && !l.forward);
  if (live.length === 0) {
    const why = links.some((l) => l.replay) ? 'A recording is replayed; nothing is recorded.' : 'There is no open link to record.';
    return { ...base, text: 'None', details: [['', why]] };
  }
  const details = live.map((l): [string, string] => [l.name, recordingLine(l)]);
  if (live.some((l) => l.recording !== null && l.recording.stopped !== null)) {
    return { ...base, text: 'Stopped', word: 'not saved', severity: 'danger', details };
  }
  if (live.every((l) => l.recording === null)) return { ...base, text: 'Off', word: 'not saved', severity: 'caution', details };
  const began = live.filter(isRecording).map((l) => l.recording?.started_unix_s ?? now_unix_s);
  return { ...base, text: began.length === 0 ? 'Waiting' : duration(Math.max(0, now_unix_s - Math.min(...began))), details };
}
