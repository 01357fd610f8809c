/** State of the message panel: open or closed, the filter, and for each vehicle the time up to which the person has read messages. */

import { severityName, type SeverityName } from '../../ui/severity';
import type { Message } from '../../live/vehicle-state';

class MessagePanel {
  open = $state(false);
  filter = $state<Filter>('all');
  private readTimes = $state.raw<Readonly<Record<string, number>>>({});

  /** Time up to which the vehicle's messages count as read; initially the time of the first call. */
  readUntil_unix_s(vehicle: string, now_unix_s: number): number {
    return this.readTimes[vehicle] ?? (this.firstCall_unix_s ??= now_unix_s);
  }

  markRead(vehicle: string, now_unix_s: number): void {
    this.readTimes = { ...this.readTimes, [vehicle]: now_unix_s };
  }

  private firstCall_unix_s: number | null = null;
}

export const panel = new MessagePanel();

export type Filter = 'errors' | 'warnings' | 'all' | 'debug';

/** The least severe MAV_SEVERITY (largest number) that each filter shows. */
const LEAST_SEVERE_SHOWN: Readonly<Record<Filter, number>> = { errors: 3, warnings: 4, all: 6, debug: 7 };

export const FILTERS: readonly { value: Filter; text: string }[] = [
  { value: 'errors', text: 'Errors' },
  { value: 'warnings', text: 'Warnings' },
  { value: 'all', text: 'All' },
  { value: 'debug', text: 'With debug' },
];

/** The newest messages that a filter shows; debug messages only if the filter includes them. */
export function filterMessages(messages: readonly Message[], count: number, filter: Filter = 'all'): Message[] {
  const lines: Message[] = [];
  for (const message of messages) {
    if (message.severity <= LEAST_SEVERE_SHOWN[filter]) lines.push(message);
    if (lines.length === count) break;
  }
  return lines;
}

export interface UnreadMessages {
  count: number;
  /** Tone of the most severe message. */
  tone: SeverityName['tone'];
}

/** Number and tone of the messages since a time, without debug messages. */
export function countUnread(messages: readonly Message[], since_unix_s: number): UnreadMessages {
  const newMessages = messages.filter((m) => m.unix_s > since_unix_s && m.severity <= LEAST_SEVERE_SHOWN.all);
  return { count: newMessages.length, tone: severityName(Math.min(7, ...newMessages.map((m) => m.severity))).tone };
}

const KIND_TEXTS: Readonly<Record<string, string>> = {
  status_text: 'Status text (STATUSTEXT)',
  event: 'Event (MAVLink events)',
  mode_changed: 'Mode changed',
  armed: 'Armed',
  disarmed: 'Disarmed',
  command: 'Command or server notice',
  link: 'Server report about a link',
  warning: 'Server warning',
};

/** The type of a message, as text. */
export function kindText(kind: string): string {
  return KIND_TEXTS[kind] ?? kind.replaceAll('_', ' ');
}

/** Date and time with tenths of a second, for the details. */
export function fullTime(unix_s: number): string {
  const date = new Date(unix_s * 1000);
  const twoDigits = (n: number): string => String(n).padStart(2, '0');
  const tenth = Math.floor((unix_s % 1) * 10);
  return `${date.getFullYear()}-${twoDigits(date.getMonth() + 1)}-${twoDigits(date.getDate())} ${twoDigits(date.getHours())}:${twoDigits(date.getMinutes())}:${twoDigits(date.getSeconds())}.${tenth}`;
}
