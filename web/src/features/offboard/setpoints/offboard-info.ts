/** Texts about a vehicle's available setpoint types, limits and failsafe, from the server's data. Pure functions. */

import { decimalsIn, inUnit, shownText, unitText } from '../../../ui/units';
import { inSentence } from '../../../app/language';
import type { components } from '../../../api/schema';
import { fixed } from '../../../ui/format';
import { boundsOf, limitProblem, limitsOf, parseTyped, quantityOf, type Quantity } from '../../../vehicle/fields';
import { KINDS, type SetpointKind } from '../../../vehicle/setpoint-kinds';

type Schemas = components['schemas'];
export type OffboardView = Schemas['OffboardView'];
export type OffboardLimits = Schemas['OffboardLimits'];
export type Failsafe = Schemas['OffboardFailsafe'];
export type OperatorLimits = OffboardLimits['operator'];
export type LimitsBody = Schemas['LimitsRequest'];
export type FailsafeAction = NonNullable<Schemas['FailsafeRequest']['action']>;

/** The server's text with the form's names of setpoint types: "thrust and torque" instead of "thrust_torque". */
export function displayText(text: string): string {
  return KINDS.reduce(
    (replaced, { kind, name }) =>
      kind.includes('_') || kind === 'actuators' ? replaced.replace(new RegExp(`\\b${kind}\\b`, 'g'), name.toLowerCase()) : replaced,
    text,
  );
}

/** Why the vehicle cannot fly a setpoint type now; null if the vehicle can fly the type, or if the server has not reported this. */
export function reasonNotFlyable(view: OffboardView | null, kind: SetpointKind): string | null {
  const availability = view?.available[kind];
  return availability === undefined || availability.can ? null : displayText(availability.why_not ?? 'Not available on this vehicle.');
}

export const FAILSAFE_ACTIONS: readonly { value: FailsafeAction; text: string }[] = [
  { value: 'hold', text: 'Hold' },
  { value: 'land', text: 'Land' },
  { value: 'rtl', text: 'Return' },
  { value: 'position', text: 'Position (sticks)' },
  { value: 'altitude', text: 'Altitude (sticks)' },
  { value: 'stabilized', text: 'Stabilized (sticks)' },
];

export interface LimitField extends Quantity {
  readonly name: Exclude<keyof OperatorLimits, 'fence' | 'obstacle_brake'>;
  readonly label: string;
  /** Name of the vehicle's own limit; null if the vehicle has none. */
  readonly vehicleLimit: keyof OffboardLimits['vehicle'] | null;
}

const limitField = (name: LimitField['name'], label: string, vehicleLimit: LimitField['vehicleLimit'] = null): LimitField => ({
  name,
  label,
  vehicleLimit,
  ...quantityOf(name, boundsOf('LimitsRequest', name)),
});

export const LIMIT_FIELDS: readonly LimitField[] = [
  limitField('speed_max_m_s', 'Maximum ground speed', 'speed_max_m_s'),
  limitField('climb_max_m_s', 'Maximum climb speed', 'climb_max_m_s'),
  limitField('sink_max_m_s', 'Maximum descent speed', 'sink_max_m_s'),
  limitField('tilt_max_rad', 'Maximum tilt', 'tilt_max_rad'),
  limitField('height_min_m', 'Minimum altitude above home'),
  limitField('height_max_m', 'Maximum altitude above home', 'height_max_m'),
  limitField('distance_max_m', 'Maximum distance from home', 'distance_max_m'),
  limitField('slew_velocity_m_s2', 'Velocity slew rate'),
];

/** Why a typed limit cannot be set; null: it can. An empty text is no limit. */
export function limitFieldProblem(text: string, field: LimitField): string | null {
  if (text.trim() === '') return null;
  const value = parseTyped(text);
  return value === null ? 'Enter a number; leave empty for no limit.' : limitProblem(value, limitsOf(field), field.unit);
}

/** A limit as text in the field's unit, without the unit: "5", "45". */
export function operatorLimitText(value: number | null | undefined, field: LimitField): string {
  return value == null ? '' : String(Number((value * field.scale).toFixed(2)));
}

/** The operator's limits in one line. */
export function limitsSummary(limits: OffboardLimits | null): string {
  if (limits === null) return 'not known yet';
  const parts = LIMIT_FIELDS.filter((f) => limits.operator[f.name] != null).map(
    (f) => `${inSentence(f.label)} ${shownText(f.unit, operatorLimitText(limits.operator[f.name], f))} ${unitText(f.unit)}`,
  );
  if (limits.operator.fence != null) parts.push('geofence');
  if (!limits.operator.obstacle_brake) parts.push('stop before obstacles: off');
  return parts.length === 0 ? 'no limits set here; the vehicle’s own limits apply' : parts.join(', ');
}

/**
 * The vehicle's own limit as placeholder of the field, without the unit: "vehicle: 5.0". The server does not tell whether a missing
 * limit is off or unknown.
 */
export function vehicleLimitText(limits: OffboardLimits | null, field: LimitField): string {
  if (field.vehicleLimit === null) return 'no limit';
  const limit = limits?.vehicle[field.vehicleLimit];
  return limit == null ? 'none known' : `vehicle: ${fixed(inUnit(field.unit, limit * field.scale), decimalsIn(field.unit, 1))}`;
}

type WireHealth = components['schemas']['OffboardStatus']['health'];

export interface StreamHealth {
  setpoint_age_s: number | null;
  /** Time until PX4's failsafe acts if no further setpoint arrives. */
  failsafe_in_s: number | null;
  /** Age of the target that the vehicle reported back. */
  echo_age_s: number | null;
  position_error_m: number | null;
  velocity_error_m_s: number | null;
  attitude_error_rad: number | null;
  yaw_error_rad: number | null;
}

/** @param age_s age of the sample. */
export function readHealth(topicValue: unknown, age_s: number): StreamHealth {
  const health = (topicValue as { health?: Partial<WireHealth> | null } | null)?.health ?? null;
  const finiteNumber = (value: unknown): number | null => (typeof value === 'number' && Number.isFinite(value) ? value : null);
  const withSampleAge = (value: unknown): number | null => (finiteNumber(value) === null ? null : (value as number) + age_s);
  return {
    setpoint_age_s: withSampleAge(health?.setpoint_age_s),
    // Not reduced by the sample's age: the server continues to send setpoints, and each setpoint restarts this time.
    failsafe_in_s: finiteNumber(health?.failsafe_in_s),
    echo_age_s: withSampleAge(health?.echo?.age_s),
    position_error_m: finiteNumber(health?.position_error_m),
    velocity_error_m_s: finiteNumber(health?.velocity_error_m_s),
    attitude_error_rad: finiteNumber(health?.attitude_error_rad),
    yaw_error_rad: finiteNumber(health?.yaw_error_rad),
  };
}
