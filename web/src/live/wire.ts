/** Frames of the telemetry socket, and their validation. */

import type { components } from '../api/schema';
import { inPageLanguage } from '../api/server-text';

export const SCHEMA_VERSION = 1;

export interface WireSample {
  vehicle: string;
  topic: string;
  vehicle_time_boot_s: number | null;
  received_unix_s: number;
  value: unknown;
}

/** A replay: its time, its speed and its vehicles. */
export type Replay = components['schemas']['Replay'];

export interface WireEvent {
  kind: string;
  vehicle: string | null;
  unix_s: number;
  severity: string | number | null;
  text: string;
  [field: string]: unknown;
}

export type Frame =
  | { type: 'hello'; schema_version: number; server_time_unix_s: number }
  | { type: 'samples'; samples: WireSample[] }
  | { type: 'event'; event: WireEvent }
  | { type: 'replays'; replays: Replay[] }
  | { type: 'error'; text: string };

function isObject(value: unknown): value is Record<string, unknown> {
  return typeof value === 'object' && value !== null && !Array.isArray(value);
}

function isSample(value: unknown): value is WireSample {
  return (
    isObject(value) &&
    typeof value['vehicle'] === 'string' &&
    typeof value['topic'] === 'string' &&
    typeof value['received_unix_s'] === 'number' &&
    'value' in value
  );
}

function toEvent(value: unknown): WireEvent | null {
  if (!isObject(value) || typeof value['kind'] !== 'string') return null;
  const severity = value['severity'];
  return {
    ...value,
    kind: value['kind'],
    vehicle: typeof value['vehicle'] === 'string' ? value['vehicle'] : null,
    unix_s: typeof value['unix_s'] === 'number' ? value['unix_s'] : 0,
    severity: typeof severity === 'string' || typeof severity === 'number' ? severity : null,
    text: typeof value['text'] === 'string' ? value['text'] : '',
  };
}

function isReplay(value: unknown): value is Replay {
  return (
    isObject(value) &&
    typeof value['name'] === 'string' &&
    Array.isArray(value['vehicles']) &&
    typeof value['speed'] === 'number' &&
    (value['position_unix_s'] === null || typeof value['position_unix_s'] === 'number')
  );
}

/** Parses a frame; null for invalid frames and for unknown types, which a newer server may send. */
export function parseFrame(data: string): Frame | null {
  let raw: unknown;
  try {
    raw = inPageLanguage<unknown>(JSON.parse(data));
  } catch {
    return null;
  }
  if (!isObject(raw)) return null;
  if (raw['type'] === 'hello' && typeof raw['schema_version'] === 'number' && typeof raw['server_time_unix_s'] === 'number') {
    return { type: 'hello', schema_version: raw['schema_version'], server_time_unix_s: raw['server_time_unix_s'] };
  }
  if (raw['type'] === 'samples' && Array.isArray(raw['samples'])) {
    return { type: 'samples', samples: raw['samples'].filter(isSample) };
  }
  if (raw['type'] === 'event') {
    const event = toEvent(raw['event']);
    return event === null ? null : { type: 'event', event };
  }
  if (raw['type'] === 'replays' && Array.isArray(raw['replays'])) {
    return { type: 'replays', replays: raw['replays'].filter(isReplay) };
  }
  if (raw['type'] === 'error') {
    const text = raw['detail'] ?? raw['message'] ?? raw['text'];
    return { type: 'error', text: typeof text === 'string' ? text : 'The server refused the subscription.' };
  }
  return null;
}
