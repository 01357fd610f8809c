/** The state of the server's setpoint stream to a vehicle, from the topic `offboard`. Null: not known or not applicable. */

import type { components } from '../api/schema';
import type { MaybeVector3, Vector3 } from '../live/topics';
import { setpointsText } from './setpoint-kinds';
import type { PositionSetpoint } from './setpoint';

export type LimitsOrigin = components['schemas']['LimitsOrigin'];

/** Obstacle avoidance, as reported by the server. */
export interface Avoidance {
  enabled: boolean;
  /** The vehicle has a sensor that detects obstacles. */
  hasSensor: boolean;
  /** clear, turning, over, around, back, stopped; null while avoidance is off or there is no stream. */
  state: string | null;
  text: string;
}

export interface OffboardStatus {
  /** The server sends setpoints to this vehicle. */
  streaming: boolean;
  /** idle, starting, streaming, interrupted, holding, to_hold, landing, undoing. */
  state: string;
  /** Type of the setpoint that is sent; a path or a followed vehicle is sent as another type. */
  type: string | null;
  /** Type of the requested setpoint. */
  requestedType: string | null;
  position_ned_m: MaybeVector3 | null;
  velocity_ned_m_s: MaybeVector3 | null;
  velocity_frd_m_s: MaybeVector3 | null;
  yaw_ned_rad: number | null;
  yaw_rate_ned_rad_s: number | null;
  rate_hz: number | null;
  rateRequested_hz: number | null;
  validFor_s: number | null;
  validLeft_s: number | null;
  /** What the vehicle does if the stream stops, as text. */
  ifStreamStops: string | null;
  /** What happens when the setpoints expire, as text. */
  expiryEffect: string | null;
  client: string | null;
  /** Distinguishes the client from other clients with the same name. */
  clientKey: string | null;
  /** The vehicle flies in a group: the server accepts setpoints only for the whole group. */
  inGroup: boolean;
  /** Origin of the operator's limits; null if an older server does not send it. */
  limitsOrigin: LimitsOrigin | null;
  /** Texts about the limits that change the setpoint now. */
  appliedLimitTexts: readonly string[];
  /** Why the last stream ended, as text. */
  endReason: string | null;
  avoidance: Avoidance;
}

type Raw = Record<string, unknown>;

function toObject(value: unknown): Raw | null {
  return typeof value === 'object' && value !== null && !Array.isArray(value) ? (value as Raw) : null;
}

function readNumber(raw: Raw | null, name: string): number | null {
  const value = raw?.[name];
  return typeof value === 'number' && Number.isFinite(value) ? value : null;
}

function readText(raw: Raw | null, name: string): string | null {
  const value = raw?.[name];
  return typeof value === 'string' && value !== '' ? value : null;
}

function readVector(raw: Raw | null, name: string): MaybeVector3 | null {
  const value = raw?.[name];
  if (!Array.isArray(value) || value.length !== 3) return null;
  return value.map((v) => (typeof v === 'number' ? v : null)) as MaybeVector3;
}

/**
 * What happens when the setpoints expire, as text.
 * @param raw `on_expiry` of a setpoint.
 * @param failsafe what the vehicle does if the stream stops, as the server's text; null: the text does not state it.
 */
export function expiryText(raw: Raw | null, failsafe: string | null = null): string | null {
  const action = readText(raw, 'action');
  if (action === 'hold') {
    const time_s = readNumber(raw, 'hold_for_s');
    return `the vehicle holds its position${time_s === null ? '' : ` for ${time_s} s`}, then the server selects Hold mode`;
  }
  if (action === 'land') return 'the vehicle lands';
  if (action !== 'stop_stream') return null;
  return `the server stops the stream and the vehicle executes its failsafe${failsafe === null ? '' : `: ${failsafe.replace(/\.$/, '')}`}`;
}

export function readOffboard(value: unknown): OffboardStatus | null {
  const raw = toObject(value);
  if (raw === null) return null;
  const setpoint = toObject(raw['setpoint']);
  const state = readText(raw, 'state') ?? 'idle';
  return {
    streaming: raw['streaming'] === true,
    state,
    type: readText(setpoint, 'type'),
    requestedType: readText(raw, 'ordered_type'),
    position_ned_m: readVector(setpoint, 'position_ned_m'),
    velocity_ned_m_s: readVector(setpoint, 'velocity_ned_m_s'),
    velocity_frd_m_s: readVector(setpoint, 'velocity_frd_m_s'),
    yaw_ned_rad: readNumber(setpoint, 'yaw_ned_rad'),
    yaw_rate_ned_rad_s: readNumber(setpoint, 'yaw_rate_ned_rad_s'),
    rate_hz: readNumber(raw, 'rate_achieved_hz'),
    rateRequested_hz: readNumber(raw, 'rate_hz'),
    validFor_s: readNumber(raw, 'valid_for_s'),
    validLeft_s: readNumber(raw, 'valid_left_s'),
    ifStreamStops: readText(raw, 'if_stream_stops'),
    expiryEffect: expiryText(toObject(raw['on_expiry'])),
    client: readText(raw, 'client'),
    clientKey: readText(raw, 'client_key'),
    inGroup: raw['owner'] === 'group',
    limitsOrigin: toObject(raw['limits_origin']) as LimitsOrigin | null,
    appliedLimitTexts: Array.isArray(raw['limited']) ? raw['limited'].filter((l): l is string => typeof l === 'string') : [],
    endReason: readText(raw, 'ended'),
    avoidance: readAvoidance(toObject(raw['avoidance'])),
  };
}

function readAvoidance(raw: Raw | null): Avoidance {
  return { enabled: raw?.['on'] === true, hasSensor: raw?.['sensor'] === true, state: readText(raw, 'state'), text: readText(raw, 'text') ?? '' };
}

const STATE_TEXTS: Readonly<Record<string, string>> = {
  idle: 'no stream',
  starting: 'Starting',
  undoing: 'Start failed: the server stops the stream',
  interrupted: 'Interrupted by the failsafe: holding position',
  holding: 'Expired: holding position',
  to_hold: 'Expired: switching to Hold',
  landing: 'Expired: landing',
};

/** Notice that a restart of the server has restored or lost the operator's limits; null: neither. */
export function limitsNotice(origin: LimitsOrigin | null | undefined): { text: string; caution: boolean } | null {
  if (origin == null) return null;
  if (origin.warning !== null) return { text: origin.warning, caution: true };
  return origin.active && origin.restored ? { text: origin.text, caution: false } : null;
}

/** State of the stream as a short text. */
export function streamText(status: OffboardStatus): string {
  const stateText = STATE_TEXTS[status.state] ?? setpointsText(status.type);
  return status.inGroup ? `Group · ${stateText}` : stateText;
}

/** Distance of the vehicle from the streamed position [m]; null if a coordinate is not known. */
export function positionError_m(status: OffboardStatus, position_ned_m: Readonly<Vector3> | null): number | null {
  const target = status.position_ned_m;
  if (target === null || position_ned_m === null || target.some((v) => v === null)) return null;
  return Math.hypot(...position_ned_m.map((v, i) => v - (target[i] ?? 0)));
}

/** The setpoint that a nudge changes: the streamed position or, without a streamed position, the vehicle's position. Null: neither is known. */
export function nudgeBase(status: OffboardStatus, position_ned_m: Readonly<Vector3> | null, yaw_ned_rad: number | null): PositionSetpoint | null {
  const target = status.position_ned_m;
  const position = target !== null && target.every((v) => v !== null) ? (target as Vector3) : position_ned_m;
  const yaw = status.yaw_ned_rad ?? yaw_ned_rad;
  return position === null || yaw === null ? null : { type: 'position', position_ned_m: position, yaw_ned_rad: yaw };
}
