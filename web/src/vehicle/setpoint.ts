/** Setpoints in the API's format, and nudging: moving a position setpoint in steps. */

import { fromUnit, stepIn } from '../ui/units';
import type { Outcome } from '../api/client';
import type { components } from '../api/schema';
import type { Vector3 } from '../live/topics';

type Schemas = components['schemas'];

export interface PositionSetpoint {
  type: 'position';
  position_ned_m: Readonly<Vector3>;
  yaw_ned_rad: number;
}

export type NudgeAxis = 'north' | 'east' | 'up' | 'yaw';

/** The distance and the turn of one nudge. */
export interface NudgeSize {
  metres: number;
  yaw_deg: number;
}

/** Steps of 0.5, 1 and 5 m, or about as much in the chosen unit. */
export function nudgeSizes(): readonly NudgeSize[] {
  const sizes = [
    { metres: 0.5, yaw_deg: 5 },
    { metres: 1, yaw_deg: 15 },
    { metres: 5, yaw_deg: 45 },
  ];
  return sizes.map(({ metres, yaw_deg }) => ({ metres: fromUnit('length', stepIn('length', metres)), yaw_deg }));
}

/** Any setpoint in the API's format. */
export type AnySetpoint = Readonly<Record<string, unknown>> & { type: string };

/** The setpoint with the type that the API's requests need; the server validates its fields. */
export const toRequestSetpoint = (setpoint: AnySetpoint): Schemas['StartGroup']['members'][number]['setpoint'] => setpoint as never;

export type OnExpiry = { action: 'hold'; hold_for_s: number } | { action: 'land' } | { action: 'stop_stream' };

/** Validity of a setpoint, the vehicle's action when it expires, and whether this page renews it. */
export interface Validity {
  valid_for_s: number;
  on_expiry: OnExpiry;
  renew: boolean;
}

/** The first setpoint of a stream. */
export interface StreamStart {
  setpoint: AnySetpoint;
  /** The same setpoint with the newest position of a device, when it is sent. */
  newest?: () => AnySetpoint;
  validity: Validity;
  rate_hz: number;
  /** Description of the setpoint, for the confirmation. */
  text: string;
  /** Called with the result of the start. */
  onOutcome?: (outcome: Outcome<unknown>) => void;
}

/** Default validity [s]. */
const VALID_FOR_S = 10;
export const ON_EXPIRY = { action: 'hold', hold_for_s: 5 } as const;
export const DEFAULT_VALIDITY: Validity = { valid_for_s: VALID_FOR_S, on_expiry: ON_EXPIRY, renew: true };

function wrapPi(angle_rad: number): number {
  const fullTurn = 2 * Math.PI;
  return ((((angle_rad + Math.PI) % fullTurn) + fullTurn) % fullTurn) - Math.PI;
}

/** The setpoint one step further along an axis; `sign` is +1 or −1. */
export function nudge(setpoint: PositionSetpoint, axis: NudgeAxis, sign: 1 | -1, size: NudgeSize): PositionSetpoint {
  const [n, e, d] = setpoint.position_ned_m;
  const step_m = sign * size.metres;
  if (axis === 'yaw') return { ...setpoint, yaw_ned_rad: wrapPi(setpoint.yaw_ned_rad + (sign * size.yaw_deg * Math.PI) / 180) };
  const positions: Record<Exclude<NudgeAxis, 'yaw'>, Vector3> = { north: [n + step_m, e, d], east: [n, e + step_m, d], up: [n, e, d - step_m] };
  return { ...setpoint, position_ned_m: positions[axis] };
}
