/** The setpoint form: its values, the errors by field, and the setpoint made from the values. Pure functions. */

import { shortText } from '../../../ui/format';
import type { VehicleFacts } from '../../../vehicle/facts';
import { limitProblem, limitsOf, parseTyped } from '../../../vehicle/fields';
import { specOf, type Axis, type SetpointQuantity, type SetpointKind } from '../../../vehicle/setpoint-kinds';

export interface Field {
  text: string;
  /** The axis is not controlled: null in the API, NaN in MAVLink. */
  isUncontrolled: boolean;
}

export type AltReference = 'alt_home_m' | 'alt_amsl_m';
export type YawChoice = 'angle' | 'rate' | 'none';
export type FollowYaw = 'keep' | 'same' | 'face';

export interface Form {
  kind: SetpointKind;
  fields: Readonly<Record<string, Field>>;
  /** Field names of the optional quantities that the setpoint does not contain. */
  omittedFields: readonly string[];
  yawChoice: YawChoice;
  /** As typed: [°] or [°/s]. */
  yaw: string;
  altReference: AltReference;
  /** The vehicle to follow; empty: not chosen. */
  followedVehicle: string;
  followYaw: FollowYaw;
}

export type SetpointJson = Readonly<Record<string, unknown>> & { type: SetpointKind };

export type BuildResult = { ok: true; setpoint: SetpointJson } | { ok: false; errors: Readonly<Record<string, string>> };

const RAD_PER_DEG = Math.PI / 180;

/** The number as text, with as many decimals as `step` has. */
function numberText(value: number, step: number): string {
  const decimals = step >= 1 ? 0 : Math.min(7, Math.ceil(-Math.log10(step) - 1e-9));
  const text = value.toFixed(Math.max(decimals, step === 0.00001 ? 7 : decimals));
  return Number(text) === 0 ? (0).toFixed(decimals) : text;
}

/** Default offset when following [m]: forward, right, up along the other vehicle's heading. */
const FOLLOW_OFFSET = { o0: -5, o1: 0, o2: 2 };
/** Smallest length of the offset when following [m]. */
const FOLLOW_MIN_M = 2;

/** A form filled with the vehicle's current state. If the form is sent unchanged, the vehicle holds its position, except for types that do not control the position. `hoverThrust`: null if not known. */
export function formFromCurrentState(kind: SetpointKind, facts: VehicleFacts, hoverThrust: number | null): Form {
  const spec = specOf(kind);
  const local = facts.localPosition?.value.position_ned_m ?? null;
  const yaw_rad = facts.attitude?.value.yaw_ned_rad ?? null;
  const global = facts.globalPosition?.value ?? null;
  const heading = yaw_rad === null ? '' : numberText((((yaw_rad / RAD_PER_DEG) % 360) + 360) % 360, 1);
  const values: Record<string, number | null> = {
    p0: local?.[0] ?? null,
    p1: local?.[1] ?? null,
    p2: local === null ? null : -local[2],
    lat: global?.lat_deg ?? null,
    lon: global?.lon_deg ?? null,
    alt: global?.alt_home_m ?? null,
    yaw: heading === '' ? null : Number(heading),
    thrust: hoverThrust,
    ...(kind === 'follow' ? FOLLOW_OFFSET : {}),
  };
  const fields: Record<string, Field> = {};
  for (const axis of spec.quantities.flatMap((q) => q.axes)) {
    const value = axis.key in values ? (values[axis.key] ?? null) : 0;
    fields[axis.key] = {
      text: value === null ? '' : numberText(value, axis.key[0] === 'p' && axis.step === 0.5 ? 0.1 : axis.key === 'alt' ? 0.1 : axis.step),
      isUncontrolled: false,
    };
  }
  return {
    kind,
    fields,
    omittedFields: spec.quantities.filter((q) => q.optional).map((q) => q.field),
    altReference: 'alt_home_m',
    followedVehicle: '',
    followYaw: 'keep',
    yawChoice: spec.yaw === 'none' ? 'none' : 'angle',
    yaw: spec.yaw === 'offset' ? '0' : heading,
  };
}

/** The API value of an axis from its typed text, or the error. */
function readAxis(axis: Axis, field: Field | undefined, nullable: boolean): { value: number | null } | { error: string } {
  if (nullable && field?.isUncontrolled === true) return { value: null };
  const value = parseTyped(field?.text ?? '');
  if (value === null) return { error: nullable ? `${axis.label}: enter a number, or press × (not controlled).` : `${axis.label}: enter a number.` };
  const problem = limitProblem(value, limitsOf(axis), axis.unit);
  if (problem !== null) return { error: `${axis.label}: ${problem.charAt(0).toLowerCase()}${problem.slice(1)}` };
  return { value: value * axis.scale + 0 };
}

function readQuantity(quantity: SetpointQuantity, form: Form, errors: Record<string, string>): unknown {
  const values = quantity.axes.map((axis) => {
    const parsed = readAxis(axis, form.fields[axis.key], quantity.nullable);
    if ('error' in parsed) errors[axis.key] = parsed.error;
    return 'error' in parsed ? null : parsed.value;
  });
  return quantity.scalar === true ? values[0] : values;
}

/** The setpoint of the form in the API's format, or the errors by field. */
export function buildSetpoint(form: Form): BuildResult {
  const spec = specOf(form.kind);
  const errors: Record<string, string> = {};
  const setpoint: Record<string, unknown> & { type: SetpointKind } = { type: form.kind };
  for (const quantity of spec.quantities) {
    if (quantity.optional && form.omittedFields.includes(quantity.field)) continue;
    setpoint[quantity.field === 'alt' ? form.altReference : quantity.field] = readQuantity(quantity, form, errors);
  }
  if (form.kind === 'trajectory') checkControlled(spec.quantities, form, errors);
  if (form.kind === 'follow') {
    if (form.followedVehicle === '') errors['followedVehicle'] = 'Choose the vehicle to follow.';
    const offset = setpoint['offset_frd_m'] as (number | null)[];
    if (offset.every((v) => v !== null) && Math.hypot(...(offset as number[])) < FOLLOW_MIN_M)
      errors['o0'] = `The offset must be at least ${shortText('length', FOLLOW_MIN_M)} long.`;
    Object.assign(setpoint, { vehicle: form.followedVehicle, yaw: form.followYaw });
  } else if (spec.yaw !== 'none' && form.yawChoice !== 'none') {
    const value = parseTyped(form.yaw);
    if (value === null) errors['yaw'] = 'Yaw: enter a number, or choose “Unchanged”.';
    else if (spec.yaw === 'offset') setpoint['yaw_offset_rad'] = wrapPi(value * RAD_PER_DEG);
    else if (form.yawChoice === 'angle') setpoint['yaw_ned_rad'] = wrapPi(value * RAD_PER_DEG);
    else setpoint['yaw_rate_ned_rad_s'] = value * RAD_PER_DEG;
  }
  if (form.kind === 'attitude' && typeof setpoint['yaw_ned_rad'] === 'number') setpoint['yaw_ned_rad'] = wrapPi(setpoint['yaw_ned_rad']);
  if (spec.quantities.length === 0) errors['kind'] = 'This link cannot send setpoints of this type.';
  return Object.keys(errors).length > 0 ? { ok: false, errors } : { ok: true, setpoint };
}

/** Adds an error for each axis that neither position nor velocity nor acceleration controls: the vehicle would not move along it. */
function checkControlled(quantities: readonly SetpointQuantity[], form: Form, errors: Record<string, string>): void {
  const includedQuantities = quantities.filter((q) => !form.omittedFields.includes(q.field));
  ['North', 'East', 'Up'].forEach((name, i) => {
    const axes = includedQuantities.map((q) => q.axes[i]).filter((a) => a !== undefined);
    const [first] = axes;
    if (first !== undefined && axes.every((a) => form.fields[a.key]?.isUncontrolled === true))
      errors[first.key] = `${name} is not controlled: give a position, a velocity or an acceleration.`;
  });
}

/** Sets whether an axis is uncontrolled. North and east of a quantity change together: the vehicle ignores one without the other. */
export function setUncontrolled(form: Form, key: string, isUncontrolled: boolean): Form {
  const horizontalPrefix = /^([pva])[01]$/.exec(key)?.[1];
  const keys = horizontalPrefix === undefined ? [key] : [`${horizontalPrefix}0`, `${horizontalPrefix}1`];
  const fields = { ...form.fields };
  for (const k of keys) fields[k] = { text: fields[k]?.text ?? '', isUncontrolled };
  return { ...form, fields };
}

function wrapPi(angle_rad: number): number {
  const fullTurn = 2 * Math.PI;
  return ((((angle_rad + Math.PI) % fullTurn) + fullTurn) % fullTurn) - Math.PI;
}
