/** The server's links and warnings. They are not part of the telemetry, so the page polls them. */

import type { Indicator } from './indicators';
import { duration, fixed, join, timeOfDay, UNKNOWN } from '../../ui/format';
import type { components } from '../../api/schema';
import type { ApiClient } from '../../api/client';

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
      await this.read(api);
      this.measureRateAndLoss();
      setTimeout(() => void request(), POLL_INTERVAL_MS);
    };
    void request();
  }

  async read(api: ApiClient): Promise<void> {
    const [links, warnings] = await Promise.all([api.get('/links'), api.get('/warnings')]);
    this.isKnown = links.ok && warnings.ok;
    this.list = links.ok ? (links.value.links ?? []) : [];
    this.notices = warnings.ok ? (warnings.value.warnings ?? []) : [];
  }

  private measureRateAndLoss(): void {
    const bytes = { count: this.list.reduce((sum, l) => sum + l.bytes_received, 0), at_ms: performance.now() };
    const received = this.lastBytes === null ? -1 : bytes.count - this.lastBytes.count;
    this.rate_bytes_s = this.lastBytes === null || received < 0 ? null : (received / (bytes.at_ms - this.lastBytes.at_ms)) * 1000;
    this.lastBytes = this.isKnown ? bytes : null;
    this.measureLoss();
  }

  private measureLoss(): void {
    const vehicleLinks = this.list.filter((l) => !l.forward && !l.guard);
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

export type ServerLink = components['schemas']['Link'];
export type ServerNotice = components['schemas']['Notice'];

const STATE_WORDS: Readonly<Record<string, string>> = {
  connecting: 'connecting',
  open: 'open',
  waiting: 'retrying',
  closed: 'closed',
  ended: 'replay ended',
};

/** A number of bytes as text. */
function bytesText(bytes: number): string {
  if (bytes < 1000) return `${bytes} B`;
  if (bytes < 999_500) return `${(bytes / 1000).toFixed(0)} kB`;
  return `${(bytes / 1e6).toFixed(1)} MB`;
}

/** Packet loss between two counts [%]; null: no packets between the counts. */
export function lossPercent(from: { received: number; lost: number }, to: { received: number; lost: number }): number | null {
  const lost = Math.max(0, to.lost - from.lost);
  const sentCount = to.received - from.received + lost;
  return sentCount <= 0 ? null : (lost / sentCount) * 100;
}

/** Packet loss since the link was opened, from gaps in the sequence numbers, as text. */
function lossText(link: ServerLink): string {
  const sentCount = link.frames_received + link.frames_lost;
  return sentCount === 0 ? UNKNOWN : `${fixed((link.frames_lost / sentCount) * 100, 1)} %`;
}

/** Maximum number of listed peers; the others are counted. */
const MAX_PEERS = 4;

function peersText(peers: readonly string[]): string {
  if (peers.length === 0) return UNKNOWN;
  const more = peers.length - MAX_PEERS;
  return [...peers.slice(0, MAX_PEERS), ...(more > 0 ? [`and ${more} more`] : [])].join('\n');
}

/** One line for each counter of a link. */
function linkLines(link: ServerLink, hasOtherLinks: boolean): [string, string][] {
  const lines: [string, string][] = hasOtherLinks ? [['', link.name]] : [['Link', link.name]];
  lines.push(
    ['State', join([STATE_WORDS[link.state] ?? link.state, link.detail])],
    ['Peers', peersText(link.peers)],
    ['Frames', `${link.frames_received} in, ${link.frames_lost} lost (${lossText(link)})`],
    ['CRC errors', String(link.crc_errors)],
    ['Bytes', join([`${bytesText(link.bytes_received)} in`, `${bytesText(link.bytes_sent)} out`])],
  );
  if (link.signing !== null) lines.push(['Signing', `key ${link.signing.key}, ${link.signing.mode}; ${link.frames_refused} frames refused`]);
  if (link.frames_unverified > 0) lines.push(['Not verified', `${link.frames_unverified} signed frames (this link has no key)`]);
  if (link.frames_unknown > 0) lines.push(['Unknown frames', String(link.frames_unknown)]);
  if (link.bytes_skipped > 0) lines.push(['Not MAVLink', `${bytesText(link.bytes_skipped)} skipped`]);
  if (link.handler_errors > 0) lines.push(['Server errors', `${link.handler_errors} messages skipped (see the server’s log)`]);
  if (link.frames_waiting > 0) lines.push(['Waiting to be sent', `${link.frames_waiting} frames`]);
  if (link.frames_expired > 0) lines.push(['Expired in the queue', `${link.frames_expired} frames`]);
  if (link.bytes_dropped > 0) lines.push(['Dropped', `${bytesText(link.bytes_dropped)} (queue full or no peer)`]);
  return lines;
}

/**
 * The counters of all links as lines, and a short text; the text is null without an open link.
 * @param rate_bytes_s received data rate of all links; null: not known yet.
 * @param lost_percent packet loss of the last half minute; null: no packets received.
 */
export function linkDetails(
  links: readonly ServerLink[],
  rate_bytes_s: number | null,
  lost_percent: number | null = null,
): { details: [string, string][]; text: string | null } {
  const details = links.flatMap((link) => linkLines(link, links.length > 1));
  const openCount = links.filter((l) => l.state === 'open' && !l.forward && !l.guard).length;
  const rate = rate_bytes_s === null ? null : `${fixed(rate_bytes_s / 1000, 1)} kB/s`;
  const text =
    openCount === 0
      ? null
      : join([
          openCount === 1 ? null : `${openCount} links`,
          rate ?? 'open',
          lost_percent === null ? null : `${fixed(lost_percent, lost_percent > 0 && lost_percent < 9.95 ? 1 : 0)} % loss`,
        ]);
  return { details, text };
}

/** Whether a link is being recorded now. */
export function isRecording(link: ServerLink): boolean {
  return link.recording !== null && link.recording.file !== null && link.recording.stopped === null;
}

function recordingLine(link: ServerLink): string {
  const recording = link.recording;
  if (recording === null) return 'not recorded';
  if (recording.stopped !== null) return recording.stopped;
  if (recording.file === null) return 'starts with the first frame';
  return join([recording.file, bytesText(recording.bytes), recording.started_unix_s === null ? null : `since ${timeOfDay(recording.started_unix_s)}`]);
}

/** State of the recordings, with the duration of the longest recording that is running. */
export function recordingIndicator(links: readonly ServerLink[], known: boolean, now_unix_s: number): Indicator {
  const commonFields = { label: 'Recording', problem: '', severity: 'none' as const, stale: false, age_s: null };
  if (!known) return { ...commonFields, text: UNKNOWN, details: [['', 'Not reported by the server yet.']] };
  const recordableLinks = links.filter((l) => !l.replay && !l.forward);
  if (recordableLinks.length === 0) {
    const why = links.some((l) => l.replay) ? 'A recording is replayed; nothing is recorded.' : 'There is no open link to record.';
    return { ...commonFields, text: 'None', details: [['', why]] };
  }
  const details = recordableLinks.map((l): [string, string] => [l.name, recordingLine(l)]);
  if (recordableLinks.some((l) => l.recording !== null && l.recording.stopped !== null)) {
    return { ...commonFields, text: 'Stopped', problem: 'not recording', severity: 'danger', details };
  }
  if (recordableLinks.every((l) => l.recording === null)) return { ...commonFields, text: 'Off', problem: 'not recording', severity: 'caution', details };
  const startTimes_unix_s = recordableLinks.filter(isRecording).map((l) => l.recording?.started_unix_s ?? now_unix_s);
  return { ...commonFields, text: startTimes_unix_s.length === 0 ? 'Waiting' : duration(Math.max(0, now_unix_s - Math.min(...startTimes_unix_s))), details };
}
