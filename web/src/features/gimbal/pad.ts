/** The gimbal pad's geometry: converts between angles and points, within the gimbal's reported limits. */

import { toDeg } from '../../ui/format';
import type { Gimbal } from '../../live/topics';
import type { Angles, AngleLimits } from '../../vehicle/gimbal';

export interface Point {
  x: number;
  y: number;
}

export const PAD = { width: 152, height: 116, margin: 8 } as const;

/** Smallest range that the pad shows [deg]; also for a gimbal without reported limits. */
const RANGE = { pitchMin: -100, pitchMax: 40, yawMin: -180, yawMax: 180 };

function padRange(limits: AngleLimits): { top: number; bottom: number; left: number; right: number } {
  return {
    top: Math.max(RANGE.pitchMax, limits.pitchMax_deg + 10),
    bottom: Math.min(RANGE.pitchMin, limits.pitchMin_deg - 10),
    left: RANGE.yawMin - 12,
    right: RANGE.yawMax + 12,
  };
}

export function toPoint(angles: Angles, limits: AngleLimits): Point {
  const r = padRange(limits);
  return {
    x: ((angles.yaw_deg - r.left) / (r.right - r.left)) * PAD.width,
    y: ((r.top - angles.pitch_deg) / (r.top - r.bottom)) * PAD.height,
  };
}

/** The angles at a point of the pad, clamped to the limits. */
export function toAngles(point: Point, limits: AngleLimits): Angles {
  const r = padRange(limits);
  const yaw = r.left + (point.x / PAD.width) * (r.right - r.left);
  const pitch = r.top - (point.y / PAD.height) * (r.top - r.bottom);
  return clamp({ pitch_deg: pitch, yaw_deg: yaw }, limits);
}

export function clamp(angles: Angles, limits: AngleLimits): Angles {
  return {
    pitch_deg: Math.min(limits.pitchMax_deg, Math.max(limits.pitchMin_deg, angles.pitch_deg)),
    yaw_deg: Math.min(limits.yawMax_deg, Math.max(limits.yawMin_deg, angles.yaw_deg)),
  };
}

/** Degrees per press of an arrow key; ten times as much with Shift, and by PageUp and PageDown. */
const KEY_STEP_DEG = 1;

/** The angles after a key press on the pad, clamped to the limits; null for other keys. */
export function anglesAfterKey(angles: Angles, key: string, shift: boolean, limits: AngleLimits): Angles | null {
  const step = KEY_STEP_DEG * (shift ? 10 : 1);
  const turned = (pitch: number, yaw: number): Angles => clamp({ pitch_deg: angles.pitch_deg + pitch, yaw_deg: angles.yaw_deg + yaw }, limits);
  switch (key) {
    case 'ArrowUp':
      return turned(step, 0);
    case 'ArrowDown':
      return turned(-step, 0);
    case 'ArrowRight':
      return turned(0, step);
    case 'ArrowLeft':
      return turned(0, -step);
    case 'PageUp':
      return turned(10 * KEY_STEP_DEG, 0);
    case 'PageDown':
      return turned(-10 * KEY_STEP_DEG, 0);
    case 'Home':
      return clamp({ pitch_deg: 0, yaw_deg: 0 }, limits);
    case 'End':
      return clamp({ pitch_deg: limits.pitchMin_deg, yaw_deg: 0 }, limits);
    default:
      return null;
  }
}

/** The angles as text for screen readers. */
export function angleText(angles: Angles): string {
  const part = (value: number, plus: string, minus: string): string => `${Math.abs(Math.round(value))}° ${Math.round(value) < 0 ? minus : plus}`;
  return `${part(angles.pitch_deg, 'up', 'down')}, ${part(angles.yaw_deg, 'right', 'left')}`;
}

/** Direction of the camera relative to the vehicle's nose; null if the gimbal does not report it. */
export function cameraDirection(gimbal: Gimbal, yaw_ned_rad: number | null): Angles | null {
  let yaw = toDeg(gimbal.yaw_frd_rad);
  if (yaw === null && gimbal.yaw_ned_rad !== null && yaw_ned_rad !== null) {
    yaw = toDeg(gimbal.yaw_ned_rad - yaw_ned_rad);
  }
  const pitch = toDeg(gimbal.pitch_rad);
  if (pitch === null) return null;
  return { pitch_deg: pitch, yaw_deg: yaw === null ? 0 : ((((yaw + 180) % 360) + 360) % 360) - 180 };
}
