/** Links and recordings as the server lists them (`GET /links`), as words for the top bar. */

import { fixed, join, UNKNOWN } from '../../ui/format';
import type { Indicator } from './indicators';

export interface LinkLine {
  name: string;
  url: string;
  open: boolean | null;
  error: string | null;
  recording: boolean | null;
  recordingError: string | null;
  recordingFile: string | null;
  loss_percent: number | null;
}

type Raw = Record<string, unknown>;

function object(value: unknown): Raw | null {
  return typeof value === 'object' && value !== null && !Array.isArray(value) ? (value as Raw) : null;
}

function text(value: unknown): string | null {
  return typeof value === 'string' && value !== '' ? value : null;
}

export function readLinks(answer: unknown): LinkLine[] {
  const list = Array.isArray(answer) ? answer : object(answer)?.['links'];
  if (!Array.isArray(list)) return [];
  return list.map(object).filter((raw): raw is Raw => raw !== null).map(readLink);
}

function readLink(raw: Raw): LinkLine {
  const info = object(raw['info']) ?? raw;
  const recording = raw['recording'] ?? info['recording'];
  const told = object(recording);
  const state = text(info['state']);
  const file = text(recording) ?? text(told?.['path']) ?? text(told?.['file']) ?? text(raw['recording_file']);
  return {
    name: text(raw['name']) ?? '?',
    url: text(raw['url']) ?? '',
    open: typeof info['open'] === 'boolean' ? info['open'] : state === null ? null : state === 'open' || state === 'up' || state === 'connected',
    error: text(info['error']) ?? text(info['last_error']),
    recording: typeof recording === 'boolean' ? recording : told !== null && typeof told['active'] === 'boolean' ? told['active'] : file === null ? null : true,
    recordingError: text(told?.['error']) ?? text(raw['recording_error']),
    recordingFile: file,
    loss_percent: typeof info['loss_percent'] === 'number' ? info['loss_percent'] : null,
  };
}

export function linkDetails(links: readonly LinkLine[]): { details: [string, string][]; text: string | null } {
  const details = links.map((l): [string, string] => [l.name, join([l.url, l.error ?? (l.open === false ? 'closed' : null), l.loss_percent === null ? null : `${fixed(l.loss_percent, 1)} % lost`])]);
  const loss = links.map((l) => l.loss_percent).filter((v): v is number => v !== null);
  return { details, text: loss.length === 0 ? null : `${fixed(Math.max(...loss), 0)} % lost` };
}

export function recordingIndicator(links: readonly LinkLine[], known: boolean): Indicator {
  const base = { label: 'Recording', word: '', severity: 'none' as const, stale: false, age_s: null };
  const told = links.filter((l) => l.recording !== null);
  if (!known || told.length === 0) return { ...base, text: UNKNOWN, details: [['', known ? 'No link that is recorded.' : 'The server has not said yet.']] };
  const details = told.map((l): [string, string] => [l.name, l.recordingError ?? l.recordingFile ?? (l.recording === true ? 'being recorded' : 'not recorded')]);
  const on = told.filter((l) => l.recording === true).length;
  if (on === told.length) return { ...base, text: 'On', details };
  const stopped = told.some((l) => l.recordingError !== null);
  return { ...base, text: on === 0 ? 'Off' : `${on} of ${told.length}`, word: stopped ? 'stopped' : '', severity: stopped ? 'danger' : 'none', details };
}
