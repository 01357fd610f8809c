/** Messages with their severity as a colour and a word; info needs no word. */

import type { Message } from '../../live/vehicle-state';

export interface SeverityWord {
  word: string;
  tone: 'danger' | 'caution' | 'dim';
}

const WORDS = ['Emergency', 'Alert', 'Critical', 'Error', 'Warning', '', '', 'Debug'];

export function severityWord(severity: number): SeverityWord {
  const tone = severity <= 3 ? 'danger' : severity === 4 ? 'caution' : 'dim';
  return { word: WORDS[severity] ?? '', tone };
}

/** The newest ones; what only a developer wants is left out. */
export function shown(messages: readonly Message[], count: number): Message[] {
  const lines: Message[] = [];
  for (const message of messages) {
    if (message.severity < 7) lines.push(message);
    if (lines.length === count) break;
  }
  return lines;
}
