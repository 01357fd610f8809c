/** The editor's fields of an item. Label and unit follow from the field's name (`acceptance_radius_m`). Pure. */

import type { Item } from './document';

export interface Field {
  readonly name: string;
  readonly label: string;
  readonly unit: string;
  readonly value: number | null;
  /** The field may be empty: the autopilot then chooses the value. */
  readonly optional: boolean;
  readonly step: number;
}

/** Suffixes of field names with their units, the longest first. */
const UNITS: readonly (readonly [string, string, number])[] = [
  ['_deg_s', '°/s', 1],
  ['_m_s', 'm/s', 0.5],
  ['_deg', '°', 1],
  ['_percent', '%', 1],
  ['_ms', 'ms', 10],
  ['_us', 'µs', 10],
  ['_hz', 'Hz', 1],
  ['_m', 'm', 1],
  ['_s', 's', 1],
];

const LABELS: Readonly<Record<string, string>> = {
  hour_utc: 'Until, hour (UTC)',
  minute_utc: 'Until, minute (UTC)',
  second_utc: 'Until, second (UTC)',
  acceptance_radius_m: 'Acceptance radius',
  pass_radius_m: 'Pass radius',
  hold_s: 'Hold for',
  yaw_ned_deg: 'Yaw from north',
  speed_m_s: 'Speed',
  delay_s: 'Wait for',
  target_index: 'From step',
  repeat: 'Repeats (−1: endless)',
  count: 'Pictures (0: until stopped)',
  abort_altitude_m: 'Abort altitude',
  speed_type: 'Speed type (0 air, 1 ground, 2 climb, 3 descent)',
  distance_m: 'Distance',
};
/**
 * Fields of the document that the editor does not show: positions have their own fields, the others are kept
 * unchanged.
 */
const NOT_SHOWN: ReadonlySet<string> = new Set([
  'lat_deg',
  'lon_deg',
  'command',
  'frame',
  'exit_xtrack',
  'leave_towards_next',
  'throttle_percent',
  'sequence',
  'abort_altitude_m',
  'pitch_deg@takeoff',
]);
/** Fields that count from 0 in the document and from 1 on the page. */
const FROM_ONE: ReadonlySet<string> = new Set(['target_index']);

export function fieldsOf(item: Item): Field[] {
  return Object.entries(item).flatMap(([name, value]): Field[] => {
    if (NOT_SHOWN.has(name) || NOT_SHOWN.has(`${name}@${item.kind}`) || !(typeof value === 'number' || (value === null && name !== 'original'))) return [];
    const [ending, unit, step] = UNITS.find(([end]) => name.endsWith(end)) ?? ['', '', 1];
    const words = name
      .slice(0, name.length - ending.length)
      .replace(/_ned$/, '')
      .replaceAll('_', ' ');
    const label = LABELS[name] ?? words.charAt(0).toUpperCase() + words.slice(1);
    const optional = value === null || name === 'yaw_ned_deg' || name.endsWith('_rate_deg_s') || item.kind === 'gimbal_pitch_yaw';
    return [{ name, label, unit, step, optional, value: value === null ? null : value + (FROM_ONE.has(name) ? 1 : 0) }];
  });
}

export type Parsed = { ok: true; value: number | null } | { ok: false; problem: string };

/** Parses typed text, with a comma or a point. Empty text is null if the field is optional. */
export function parseNumber(text: string, limits: { optional?: boolean; min?: number; max?: number } = {}): Parsed {
  const plain = text.trim().replace(',', '.').replace('−', '-');
  if (plain === '') return limits.optional === true ? { ok: true, value: null } : { ok: false, problem: 'Enter a number.' };
  const value = Number(plain);
  if (!Number.isFinite(value)) return { ok: false, problem: `“${text.trim()}” is not a number.` };
  const { min = -1e9, max = 1e9 } = limits;
  if (value < min || value > max) return { ok: false, problem: `Enter a number from ${min} to ${max}.` };
  return { ok: true, value };
}

/** Converts a field's value to the document's unit. */
export function toDocument(name: string, value: number | null): number | null {
  return value !== null && FROM_ONE.has(name) ? Math.round(value) - 1 : name === 'repeat' && value !== null ? Math.round(value) : value;
}
