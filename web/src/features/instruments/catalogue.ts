/**
 * All values that the grid can show: the fields of the server's topics, with readable names. The suffix of a field name
 * gives the unit. The grid shows angles in degrees.
 */

import { unitText } from '../../ui/units';
import { FIELDS } from '../../api/fields';
import type { VehicleFacts } from '../../vehicle/facts';
import type { FlightClock } from '../../live/flight-time';
import type { Reading } from '../../live/vehicle-state';
import { DEG_PER_RAD, distance, duration, fixed, heading, shown, UNKNOWN } from '../../ui/format';
import { headingDeg } from './attitude';

/** The data from which a value is read. */
export interface Source {
  facts: VehicleFacts;
  flight: FlightClock | undefined;
  topic: (name: string) => Reading<Record<string, unknown>> | null;
}

export interface DisplayedValue {
  text: string;
  unit: string;
  stale: boolean;
  age_s: number | null;
}

export interface Quantity {
  /** "topic.field", "topic.field.2", or "flown.…" for derived values. The browser stores this id. */
  id: string;
  label: string;
  group: string;
  /** A text, or a quantity of `ui/units.ts`. */
  unit: string;
  topic: string | null;
  read: (source: Source) => DisplayedValue;
}

const UNITS: readonly [string, string, number, number][] = [
  // suffix, unit or quantity (`ui/units.ts`), factor, decimals
  ['_rad_s', '°/s', DEG_PER_RAD, 1],
  ['_deg_s', '°/s', 1, 1],
  ['_m_s2', 'm/s²', 1, 2],
  ['_m_s', 'speed', 1, 1],
  ['_rad', '°', DEG_PER_RAD, 1],
  ['_deg', '°', 1, 1],
  ['_percent', '%', 1, 0],
  ['_mah', 'mAh', 1, 0],
  ['_us', 'µs', 1, 0],
  ['_m', 'length', 1, 1],
  ['_s', 's', 1, 1],
  ['_v', 'V', 1, 2],
  ['_a', 'A', 1, 1],
];
/** Names of fields whose lengths and speeds are vertical. */
const VERTICAL = /(^|_)(alt|climb|vertical|height)_/;
const VERTICAL_QUANTITY: Readonly<Record<string, string>> = { length: 'height', speed: 'climb' };
const NED_AXIS_WORDS = ['north', 'east', 'down'] as const;

const GROUP_LABELS: Readonly<Record<string, string>> = {
  status: 'Vehicle',
  attitude: 'Attitude',
  local_position: 'Local position',
  global_position: 'Global position',
  gps: 'GPS',
  battery: 'Battery',
  home: 'Home',
  gimbal: 'Gimbal',
  motors: 'Motors',
  target_local: 'Position target',
  target_attitude: 'Attitude target',
  hud: 'Speeds',
  health: 'Health',
  estimator: 'Estimator',
  mission: 'Mission',
  obstacle_distance: 'Obstacle sensor',
  wind: 'Wind',
  orbit: 'Orbit',
};
/** Labels of fields; of a vector in NED, the label without its axis. */
const LABELS: Readonly<Record<string, string>> = {
  'status.mode_label': 'Mode',
  'status.landed_state': 'Landed state',
  'status.armed': 'Armed',
  'status.last_heartbeat_age_s': 'Heartbeat age',
  'attitude.roll_rad': 'Roll',
  'attitude.pitch_rad': 'Pitch',
  'attitude.yaw_ned_rad': 'Yaw',
  'local_position.position_ned_m': 'Local',
  'local_position.velocity_ned_m_s': 'Local velocity',
  'global_position.lat_deg': 'Latitude',
  'global_position.lon_deg': 'Longitude',
  'global_position.alt_amsl_m': 'Altitude AMSL',
  'global_position.alt_home_m': 'Above home',
  'global_position.velocity_ned_m_s': 'Velocity',
  'global_position.heading_deg': 'Heading',
  'gps.satellites': 'Satellites',
  'gps.hdop': 'HDOP',
  'gps.horizontal_accuracy_m': 'GPS accuracy',
  'gps.fix_type': 'GPS fix type',
  'home.lat_deg': 'Home latitude',
  'home.lon_deg': 'Home longitude',
  'home.alt_amsl_m': 'Home altitude AMSL',
  'home.position_ned_m': 'Home position',
  'battery.remaining_percent': 'Battery charge',
  'battery.time_remaining_s': 'Battery time left',
  'battery.voltage_v': 'Battery voltage',
  'battery.current_a': 'Battery current',
  'battery.consumed_mah': 'Battery consumed',
  'gimbal.yaw_frd_rad': 'Gimbal yaw, from nose',
  'gimbal.yaw_ned_rad': 'Gimbal yaw, from north',
  'gimbal.pitch_rad': 'Gimbal pitch',
  'gimbal.roll_rad': 'Gimbal roll',
  'gimbal.yaw_lock': 'Gimbal yaw lock',
  'gimbal.pitch_min_rad': 'Gimbal pitch, minimum',
  'gimbal.pitch_max_rad': 'Gimbal pitch, maximum',
  'gimbal.yaw_min_rad': 'Gimbal yaw, minimum',
  'gimbal.yaw_max_rad': 'Gimbal yaw, maximum',
  'target_local.position_ned_m': 'Target position',
  'target_local.velocity_ned_m_s': 'Target velocity',
  'target_local.acceleration_ned_m_s2': 'Target acceleration',
  'target_local.yaw_ned_rad': 'Target yaw',
  'target_local.yaw_rate_ned_rad_s': 'Target yaw rate',
  'target_attitude.thrust': 'Target thrust',
  'hud.groundspeed_m_s': 'Ground speed',
  'hud.airspeed_m_s': 'Airspeed',
  'hud.climb_m_s': 'Vertical speed (VFR_HUD)',
  'hud.throttle_percent': 'Throttle',
  'health.cpu_load': 'CPU load',
  'health.ready_to_arm': 'Ready to arm',
  'estimator.horizontal_accuracy_m': 'Position accuracy',
  'estimator.vertical_accuracy_m': 'Altitude accuracy',
  'mission.current': 'Mission item',
  'mission.count': 'Mission items',
  'mission.reached': 'Mission item reached',
  'obstacle_distance.frame': 'Obstacle sensor frame',
  'obstacle_distance.first_deg': 'Obstacle sensor angle offset',
  'obstacle_distance.step_deg': 'Obstacle sensor angle increment',
  'obstacle_distance.range_min_m': 'Obstacle sensor minimum range',
  'obstacle_distance.range_max_m': 'Obstacle sensor maximum range',
  'wind.wind_ned_m_s': 'Wind towards',
  'wind.speed_m_s': 'Wind speed',
  'orbit.lat_deg': 'Orbit latitude',
  'orbit.lon_deg': 'Orbit longitude',
  'orbit.alt_amsl_m': 'Orbit altitude AMSL',
  'orbit.radius_m': 'Orbit radius',
  'orbit.clockwise': 'Orbit clockwise',
};
/** Labels of the elements of lists, and of vectors in the vehicle's own axes. The grid does not offer other lists, for example the sectors of an obstacle sensor. */
const ELEMENT_LABELS: Readonly<Record<string, readonly string[]>> = {
  'attitude.rates_frd_rad_s': ['Roll rate', 'Pitch rate', 'Yaw rate'],
  'target_attitude.rates_frd_rad_s': ['Target roll rate', 'Target pitch rate', 'Target yaw rate'],
  'battery.cell_voltages_v': [1, 2, 3, 4, 5, 6].map((n) => `Cell ${n}`),
  'motors.pwm_us': [1, 2, 3, 4, 5, 6, 7, 8].map((n) => `Motor ${n}`),
};
/** Values of fields that are words of the API. */
const VALUE_WORDS: Readonly<Record<string, string>> = {
  on_ground: 'on the ground',
  in_air: 'in the air',
  taking_off: 'taking off',
  landing: 'landing',
  unknown: 'unknown',
};
/** Fields that the grid does not offer, for example bit masks, ids and quaternions. */
const HIDDEN_FIELDS = /custom_mode$|system_status|sensors_|flags|_id$|^mode$|yaw_in_earth_frame|_control$|^q$|^q_|link_lost/;
const INTEGER_FIELDS = new Set(['satellites', 'fix_type', 'current', 'count', 'reached']);
/** Fields with the number of a mission item: the vehicle counts items from 0, the page from 1. */
const ITEM_NUMBER_FIELDS = new Set(['mission.current', 'mission.reached']);
const LAT_LON = /^(lat|lon)_deg$/;

/** How a field is displayed, from its name: unit, factor to that unit, and decimals. */
function fieldFormat(field: string): { unit: string; factor: number; decimals: number } {
  const entry = UNITS.find(([suffix]) => field.endsWith(suffix));
  return { unit: entry?.[1] ?? '', factor: entry?.[2] ?? 1, decimals: entry?.[3] ?? 1 };
}

const YES_TEXT = 'yes';
const NO_TEXT = 'no';

function plainText(value: unknown, factor: number, decimals: number): string {
  if (typeof value === 'number') return fixed(value * factor, Number.isInteger(value) && factor === 1 && decimals === 1 ? 0 : decimals);
  if (typeof value === 'boolean') return value ? YES_TEXT : NO_TEXT;
  return typeof value === 'string' && value !== '' ? (VALUE_WORDS[value] ?? value.replaceAll('_', ' ')) : UNKNOWN;
}

function fieldQuantity(topic: string, field: string, index: number | null, label: string): Quantity {
  const { unit, factor, decimals } = fieldFormat(field);
  const isVertical = VERTICAL.test(field) || (index === 2 && field.includes('_ned'));
  const quantity = (isVertical ? VERTICAL_QUANTITY[unit] : undefined) ?? unit;
  const isLatLon = LAT_LON.test(field);
  const isInteger = index === null && INTEGER_FIELDS.has(field);
  const numberOffset = ITEM_NUMBER_FIELDS.has(`${topic}.${field}`) ? 1 : 0;
  return {
    id: index === null ? `${topic}.${field}` : `${topic}.${field}.${index}`,
    label,
    unit: quantity,
    topic,
    group: GROUP_LABELS[topic] ?? topic,
    read: (source) => {
      const reading = source.topic(topic);
      const fieldValue = reading?.value[field];
      const value = index === null ? fieldValue : Array.isArray(fieldValue) ? (fieldValue as unknown[])[index] : null;
      // A float always shows all its decimals, because a number that changes its width is hard to read.
      const text =
        typeof value === 'number' && !isInteger
          ? shown(quantity, value * factor, isLatLon ? 6 : unit === '' ? 2 : decimals).text
          : plainText(typeof value === 'number' ? value + numberOffset : value, factor, decimals);
      return { text, unit: unitText(quantity), stale: reading?.stale ?? false, age_s: reading?.age_s ?? null };
    },
  };
}

function topicQuantities(topic: string, fields: Readonly<Record<string, string>>): Quantity[] {
  return Object.entries(fields).flatMap(([field, kind]): Quantity[] => {
    if (HIDDEN_FIELDS.test(field)) return [];
    const label = LABELS[`${topic}.${field}`] ?? field.replaceAll('_', ' ');
    const elements = ELEMENT_LABELS[`${topic}.${field}`] ?? (kind === 'vector3' ? NED_AXIS_WORDS.map((axis) => `${label} ${axis}`) : []);
    if (kind === 'list' || kind.startsWith('vector')) return elements.map((element, i) => fieldQuantity(topic, field, i, element));
    return [fieldQuantity(topic, field, null, label)];
  });
}

const DERIVED_QUANTITIES: readonly Quantity[] = [
  {
    id: 'flown.climb',
    label: 'Vertical speed',
    group: 'In flight',
    unit: 'climb',
    topic: null,
    read: ({ facts }) => {
      const { speed_m_s, stale, age_s } = verticalSpeed(facts);
      return { ...shown('climb', speed_m_s, 1, true), stale, age_s };
    },
  },
  {
    id: 'flown.from_home',
    label: 'From home',
    group: 'In flight',
    unit: 'length',
    topic: null,
    read: ({ facts }) => ({ ...distance(facts.homeDistance_m), stale: facts.globalPosition?.stale ?? false, age_s: facts.globalPosition?.age_s ?? null }),
  },
  {
    id: 'flown.time',
    label: 'Flight time',
    group: 'In flight',
    unit: '',
    topic: null,
    read: ({ facts, flight }) => ({
      text: flightTimeText(facts, flight),
      unit: '',
      stale: facts.lost,
      age_s: facts.lost ? (facts.status?.age_s ?? null) : null,
    }),
  },
  {
    id: 'flown.heading',
    label: 'Heading',
    group: 'In flight',
    unit: '°',
    topic: null,
    read: ({ facts }) => ({ text: heading(headingDeg(facts)), unit: '°', stale: facts.attitude?.stale ?? false, age_s: facts.attitude?.age_s ?? null }),
  },
];

export const CATALOGUE: readonly Quantity[] = [...DERIVED_QUANTITIES, ...Object.entries(FIELDS).flatMap(([topic, fields]) => topicQuantities(topic, fields))];
export const QUANTITIES_BY_ID: ReadonlyMap<string, Quantity> = new Map(CATALOGUE.map((q) => [q.id, q]));

export const DEFAULT_IDS: readonly string[] = [
  'flown.climb',
  'flown.from_home',
  'flown.time',
  'flown.heading',
  'local_position.position_ned_m.0',
  'local_position.position_ned_m.1',
];

/** The chosen ids that exist in the catalogue; the default ids if none were chosen. */
export function readChoice(chosenIds: readonly string[] | null): readonly string[] {
  return chosenIds === null ? DEFAULT_IDS : [...new Set(chosenIds.filter((id) => QUANTITIES_BY_ID.has(id)))];
}

/** The list with one element moved to another index. */
export function moveItem(ids: readonly string[], from: number, to: number): string[] {
  const id = ids[from];
  if (id === undefined) return [...ids];
  const otherIds = ids.filter((_, i) => i !== from);
  otherIds.splice(Math.min(Math.max(0, to), otherIds.length), 0, id);
  return otherIds;
}

/** Values that are not on the grid yet and match the typed text by name, unit or group. */
export function searchValues(searchText: string, chosenIds: readonly string[]): Quantity[] {
  const words = searchText
    .toLowerCase()
    .split(/\s+/)
    .filter((w) => w !== '');
  return CATALOGUE.filter((q) => {
    const text = `${q.label} ${q.group} ${unitText(q.unit)} ${q.id}`.toLowerCase();
    return !chosenIds.includes(q.id) && words.every((w) => text.includes(w));
  });
}

export interface VerticalSpeed {
  speed_m_s: number | null;
  stale: boolean;
  age_s: number | null;
}

/** Vertical speed (up is positive) from the HUD message; if there is none, from the global position. */
export function verticalSpeed(facts: Pick<VehicleFacts, 'hud' | 'globalPosition'>): VerticalSpeed {
  const source = facts.hud ?? facts.globalPosition;
  const speed_m_s = facts.hud?.value.climb_m_s ?? (facts.globalPosition === null ? null : -facts.globalPosition.value.velocity_ned_m_s[2]);
  return { speed_m_s, stale: source?.stale ?? false, age_s: source?.age_s ?? null };
}

/**
 * Time since take-off, with "> " if the page connected during the flight. On the ground: the duration of the last
 * flight.
 */
export function flightTimeText(facts: Pick<VehicleFacts, 'lost' | 'now_unix_s'>, clock: FlightClock | undefined): string {
  if (clock === undefined) return UNKNOWN;
  if (clock.airborneSince_unix_s !== null) {
    const until_unix_s = facts.lost ? clock.updated_unix_s : facts.now_unix_s;
    return `${clock.exact ? '' : '> '}${duration(until_unix_s - clock.airborneSince_unix_s)}`;
  }
  return duration(clock.lastFlight_s);
}
