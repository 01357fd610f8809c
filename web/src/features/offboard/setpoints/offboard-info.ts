/** The server's data about offboard on a vehicle besides the stream: possible kinds, limits, failsafe. Pure. */

import type { components } from '../../../api/schema';
import { fixed } from '../../../ui/format';
import { KINDS, type SetpointKind } from '../../../vehicle/setpoint-kinds';

type Schemas = components['schemas'];
export type OffboardView = Schemas['OffboardView'];
export type OffboardLimits = Schemas['OffboardLimits'];
export type Failsafe = Schemas['OffboardFailsafe'];
export type OperatorLimits = OffboardLimits['operator'];
export type LimitsBody = Schemas['LimitsRequest'];
export type FailsafeAction = NonNullable<Schemas['FailsafeRequest']['action']>;

/** The server's text with the form's names of kinds: "thrust and torque" instead of "thrust_torque". */
export function displayText(text: string): string {
  return KINDS.reduce(
    (text, one) => (one.kind.includes('_') || one.kind === 'actuators' ? text.replace(new RegExp(`\\b${one.kind}\\b`, 'g'), one.name.toLowerCase()) : text),
    text,
  );
}

/** Why a kind is not possible now; null if it is, or if the server has not reported it. */
export function whyNot(view: OffboardView | null, kind: SetpointKind): string | null {
  const availability = view?.available[kind];
  return availability === undefined || availability.can ? null : displayText(availability.why_not ?? 'Not on this vehicle.');
}

export const FAILSAFE_ACTIONS: readonly { value: FailsafeAction; text: string }[] = [
  { value: 'hold', text: 'Hold' },
  { value: 'land', text: 'Land' },
  { value: 'rtl', text: 'Return' },
  { value: 'position', text: 'Position (sticks)' },
  { value: 'altitude', text: 'Altitude (sticks)' },
  { value: 'stabilized', text: 'Stabilized (sticks)' },
];

export interface LimitField {
  name: Exclude<keyof OperatorLimits, 'fence' | 'obstacle_brake'>;
  label: string;
  unit: string;
  /** API value = typed × scale. */
  scale: number;
  /** The vehicle's own limit, if it has one. */
  own: keyof OffboardLimits['vehicle'] | null;
}

const RAD = Math.PI / 180;

export const LIMIT_FIELDS: readonly LimitField[] = [
  { name: 'speed_max_m_s', label: 'Ground speed', unit: 'm/s', scale: 1, own: 'speed_max_m_s' },
  { name: 'climb_max_m_s', label: 'Climb', unit: 'm/s', scale: 1, own: 'climb_max_m_s' },
  { name: 'sink_max_m_s', label: 'Descent', unit: 'm/s', scale: 1, own: 'sink_max_m_s' },
  { name: 'tilt_max_rad', label: 'Tilt', unit: '°', scale: RAD, own: 'tilt_max_rad' },
  { name: 'height_min_m', label: 'Minimum altitude above home', unit: 'm', scale: 1, own: null },
  { name: 'height_max_m', label: 'Maximum altitude above home', unit: 'm', scale: 1, own: 'height_max_m' },
  { name: 'distance_max_m', label: 'Distance from home', unit: 'm', scale: 1, own: 'distance_max_m' },
  { name: 'slew_velocity_m_s2', label: 'Velocity slew rate', unit: 'm/s²', scale: 1, own: null },
];

/** A limit as text: "5", "45". */
export function limitText(value: number | null | undefined, field: LimitField): string {
  return value == null ? '' : String(Number((value / field.scale).toFixed(2)));
}

/** The operator's limits in one line; unlimited values are left out. */
export function limitsText(limits: OffboardLimits | null): string {
  if (limits === null) return 'not known yet';
  const parts = LIMIT_FIELDS.filter((f) => limits.operator[f.name] != null).map(
    (f) => `${f.label.toLowerCase()} ${limitText(limits.operator[f.name], f)} ${f.unit}`,
  );
  if (limits.operator.fence != null) parts.push('geofence');
  if (!limits.operator.obstacle_brake) parts.push('does not stop before obstacles');
  return parts.length === 0 ? 'no limits set here; the vehicle’s own limits apply' : parts.join(', ');
}

/** The vehicle's own limit for the field's placeholder, for example "5.0 m/s". */
export function ownLimit(limits: OffboardLimits | null, field: LimitField): string {
  const own = field.own === null ? null : limits?.vehicle[field.own];
  return own == null ? 'no limit' : fixed(own / field.scale, 1);
}
