/** Maps a gamepad's axes to a setpoint: dead zone, expo, scaling. Pure functions. */

import type { Vector3 } from '../../../live/topics';
import { shapeAxis, type StickCurve } from '../../../vehicle/gamepad';

/** Stick positions from the pilot's view, each −1 to 1. */
export interface Sticks {
  forward: number;
  right: number;
  up: number;
  /** Clockwise, seen from above. */
  turn: number;
}

export const CENTRED_STICKS: Sticks = { forward: 0, right: 0, up: 0, turn: 0 };

export const STICK_CURVE: StickCurve = { deadZone: 0.1, expo: 0.4 };

/** Values at full stick deflection. */
export interface Scale {
  speed_m_s: number;
  climb_m_s: number;
  turn_deg_s: number;
  tilt_deg: number;
}

export const SCALES: readonly { name: string; scale: Scale }[] = [
  { name: 'Gentle', scale: { speed_m_s: 1, climb_m_s: 0.5, turn_deg_s: 20, tilt_deg: 8 } },
  { name: 'Normal', scale: { speed_m_s: 3, climb_m_s: 1, turn_deg_s: 45, tilt_deg: 15 } },
  { name: 'Fast', scale: { speed_m_s: 6, climb_m_s: 2, turn_deg_s: 90, tilt_deg: 25 } },
];

/** Velocity along heading, velocity along north, or attitude. */
export type PadMode = 'heading' | 'north' | 'attitude';

const RAD_PER_DEG = Math.PI / 180;

/**
 * The stick positions from the four axes of the standard gamepad layout: the left stick climbs and turns, the right stick
 * moves horizontally. Gamepads report down as positive.
 */
export function sticksOf(axes: readonly number[], curve: StickCurve): Sticks {
  const [leftX = 0, leftY = 0, rightX = 0, rightY = 0] = axes.map((a) => shapeAxis(a, curve));
  return { forward: 0 - rightY, right: rightX, up: 0 - leftY, turn: leftX };
}

export interface VelocitySetpoint {
  type: 'velocity' | 'velocity_body';
  velocity_ned_m_s?: Vector3;
  velocity_frd_m_s?: Vector3;
  yaw_rate_ned_rad_s: number;
}

export interface AttitudeSetpoint {
  type: 'attitude';
  roll_rad: number;
  pitch_rad: number;
  yaw_ned_rad: number;
  thrust: number;
}

export type PadSetpoint = VelocitySetpoint | AttitudeSetpoint;

/** The stop setpoint, sent in every mode when the deadman button is released. */
export const STOP_SETPOINT: VelocitySetpoint = { type: 'velocity_body', velocity_frd_m_s: [0, 0, 0], yaw_rate_ned_rad_s: 0 };

/** Velocity along heading or north; diagonal deflection is limited to full speed. */
export function velocitySetpoint(sticks: Sticks, mode: 'heading' | 'north', scale: Scale): VelocitySetpoint {
  const norm = Math.max(1, Math.hypot(sticks.forward, sticks.right));
  const velocity_m_s: Vector3 = [(sticks.forward / norm) * scale.speed_m_s, (sticks.right / norm) * scale.speed_m_s, 0 - sticks.up * scale.climb_m_s];
  const yaw_rate_ned_rad_s = sticks.turn * scale.turn_deg_s * RAD_PER_DEG;
  return mode === 'heading'
    ? { type: 'velocity_body', velocity_frd_m_s: velocity_m_s, yaw_rate_ned_rad_s }
    : { type: 'velocity', velocity_ned_m_s: velocity_m_s, yaw_rate_ned_rad_s };
}

/**
 * Attitude and thrust. The middle of the left stick gives the hover thrust. The caller integrates `yaw_ned_rad` from
 * `sticks.turn`.
 */
export function attitudeSetpoint(sticks: Sticks, yaw_ned_rad: number, hoverThrust: number, scale: Scale): AttitudeSetpoint {
  const tilt_rad = scale.tilt_deg * RAD_PER_DEG;
  const norm = Math.max(1, Math.hypot(sticks.forward, sticks.right));
  const thrustRange = sticks.up >= 0 ? 1 - hoverThrust : hoverThrust;
  return {
    type: 'attitude',
    roll_rad: (sticks.right / norm) * tilt_rad,
    pitch_rad: 0 - (sticks.forward / norm) * tilt_rad,
    yaw_ned_rad,
    thrust: Math.min(1, Math.max(0, hoverThrust + sticks.up * thrustRange)),
  };
}
