/** Titles and details of a plan's items, and the default values of new ones. */

import { fixed } from '../../ui/format';
import type { GeoPosition } from '../../vehicle/geo';
import { isPlaced, type Altitude, type Item, type ItemKind, type Reference } from './document';

const TITLES: Readonly<Partial<Record<ItemKind, string>>> = {
  takeoff: 'Take off',
  waypoint: 'Waypoint',
  loiter_unlimited: 'Hold until continued',
  loiter_time: 'Hold',
  loiter_to_altitude: 'Climb or descend',
  land: 'Land',
  roi_location: 'Look at a point',
  roi: 'Region of interest (older command)',
  roi_next_waypoint: 'Look at the next waypoint',
  roi_none: 'Clear region of interest',
  gate: 'Gate',
  return_home: 'Return',
  delay: 'Wait',
  jump: 'Repeat from',
  change_speed: 'Change speed',
  set_home: 'Set home here',
  land_start: 'Landing sequence start',
  photo_start: 'Take pictures',
  photo_stop: 'Stop taking pictures',
  video_start: 'Start video',
  video_stop: 'Stop video',
  trigger_distance: 'Picture every …',
  gimbal_pitch_yaw: 'Gimbal angles',
};

const REFERENCES: Readonly<Record<Reference, string>> = { home: 'above home', amsl: 'AMSL', terrain: 'above terrain' };

export const REFERENCE_CHOICES = (Object.keys(REFERENCES) as Reference[]).map((value) => ({ value, text: REFERENCES[value] }));

export function altitudeText(altitude: Altitude): string {
  return `${fixed(altitude.value_m, 1)} m ${REFERENCES[altitude.reference]}`;
}

export function titleOf(item: Pick<Item, 'kind'> & { readonly [field: string]: unknown }): string {
  if (item.kind === 'complex') return `Pattern (${String(item['complex_type'])})`;
  if (item.kind === 'trigger_distance' && item['distance_m'] === 0) return 'Stop taking pictures';
  if (item.kind === 'command') return `MAV_CMD ${String(item['command'])}`;
  const words = item.kind.replaceAll('_', ' ');
  return TITLES[item.kind] ?? words.charAt(0).toUpperCase() + words.slice(1);
}

const number = (item: Item, field: string): number | null => (typeof item[field] === 'number' ? item[field] : null);

/** Text below the title. */
export function detailOf(item: Item): string {
  const parts: string[] = [];
  const add = (field: string, words: (value: number) => string): void => {
    const value = number(item, field);
    if (value !== null && value !== 0) parts.push(words(value));
  };
  if (isPlaced(item)) parts.push(altitudeText(item.altitude));
  if (item.kind === 'complex') parts.push(`${item.items?.length ?? 0} items of another program`);
  if (item.kind === 'jump')
    parts.push(
      `step ${(number(item, 'target_index') ?? 0) + 1}`,
      number(item, 'repeat') === -1 ? 'endless' : item['repeat'] === 1 ? 'once' : `${String(item['repeat'])} times`,
    );
  if (item.kind === 'takeoff' || item.kind === 'land') return parts.join(' · ');
  add('hold_s', (s) => `hold ${fixed(s, 0)} s`);
  add('delay_s', (s) => (s < 0 ? 'until a time of day' : `${fixed(s, 0)} s`));
  add('speed_m_s', (v) => `${fixed(v, 1)} m/s`);
  add('distance_m', (m) => `${fixed(m, 1)} m`);
  add('interval_s', (s) => `every ${fixed(s, 1)} s`);
  add('count', (n) => `${n} ${n === 1 ? 'picture' : 'pictures'}`);
  add('pitch_deg', (deg) => `pitch ${fixed(deg, 0)}°`);
  add('yaw_deg', (deg) => `yaw ${fixed(deg, 0)}°`);
  return parts.join(' · ');
}

/** One kind of item to add; `placed`: it needs a click on the map. */
export interface Choice {
  readonly kind: ItemKind;
  readonly placed: boolean;
}

const PLACED: readonly ItemKind[] = ['takeoff', 'waypoint', 'loiter_time', 'land', 'roi_location'];
const OTHERS: readonly ItemKind[] = [
  'return_home',
  'change_speed',
  'delay',
  'roi_none',
  'gimbal_pitch_yaw',
  'trigger_distance',
  'photo_start',
  'photo_stop',
  'jump',
];
export const CHOICES: readonly Choice[] = [...PLACED.map((kind) => ({ kind, placed: true })), ...OTHERS.map((kind) => ({ kind, placed: false }))];

/** All fields of a new item. The editor shows only these fields. */
const DEFAULT_FIELDS: Readonly<Partial<Record<ItemKind, object>>> = {
  takeoff: { pitch_deg: 0, yaw_ned_deg: null },
  waypoint: { hold_s: 0, acceptance_radius_m: 0, pass_radius_m: 0, yaw_ned_deg: null },
  loiter_time: { hold_s: 10, radius_m: 0, exit_xtrack: 0 },
  land: { abort_altitude_m: 0, precision: 0, yaw_ned_deg: null },
  roi_location: { gimbal_id: 0 },
  return_home: {},
  change_speed: { speed_type: 1, speed_m_s: 5, throttle_percent: -1 },
  delay: { delay_s: 5, hour_utc: 0, minute_utc: 0, second_utc: 0 },
  roi_none: { gimbal_id: 0 },
  gimbal_pitch_yaw: { pitch_deg: -90, yaw_deg: 0, pitch_rate_deg_s: null, yaw_rate_deg_s: null, flags: 0, gimbal_id: 0 },
  trigger_distance: { distance_m: 10, shutter_ms: 0, at_once: 1, camera: 0 },
  photo_start: { camera: 0, interval_s: 0, count: 1, sequence: 0 },
  photo_stop: { camera: 0 },
  jump: { target_index: 0, repeat: 1 },
};

/** @param at position of a placed kind. */
export function newItem(kind: ItemKind, at: GeoPosition | null, altitude: Altitude): Item {
  const where =
    at === null
      ? {}
      : { lat_deg: at.lat_deg, lon_deg: at.lon_deg, altitude: { ...altitude, value_m: kind === 'land' || kind === 'roi_location' ? 0 : altitude.value_m } };
  return { kind, autocontinue: true, spare_params: [], original: null, ...DEFAULT_FIELDS[kind], ...where };
}
