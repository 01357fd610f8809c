/** The gimbal pad: converts between angles and points within the gimbal's limits, changes angles by key presses, and describes angles as text. */

import { toDeg } from '../../ui/format';
import type { Gimbal } from '../../live/topics';
import type { Angles, AngleLimits } from '../../vehicle/gimbal';

export interface Point {
  x: number;
  y: number;
}

/** Size of the pad [px]. */
export const PAD = { width: 152, height: 116 } as const;

/** Smallest range of angles that the pad shows [deg], also for a gimbal without reported limits. */
const SMALLEST_RANGE_DEG = { pitchMin: -100, pitchMax: 40, yawMin: -180, yawMax: 180 };

/** The angles at the edges of the pad [deg], with a margin outside the limits. */
function edgeAngles(limits: AngleLimits): { top: number; bottom: number; left: number; right: number } {
  return {
    top: Math.max(SMALLEST_RANGE_DEG.pitchMax, limits.pitchMax_deg + 10),
    bottom: Math.min(SMALLEST_RANGE_DEG.pitchMin, limits.pitchMin_deg - 10),
    left: SMALLEST_RANGE_DEG.yawMin - 12,
    right: SMALLEST_RANGE_DEG.yawMax + 12,
  };
}

export function toPoint(angles: Angles, limits: AngleLimits): Point {
  const edges = edgeAngles(limits);
  return {
    x: ((angles.yaw_deg - edges.left) / (edges.right - edges.left)) * PAD.width,
    y: ((edges.top - angles.pitch_deg) / (edges.top - edges.bottom)) * PAD.height,
  };
}

/** The angles at a point of the pad, clamped to the limits. */
export function toAngles(point: Point, limits: AngleLimits): Angles {
  const edges = edgeAngles(limits);
  const yaw = edges.left + (point.x / PAD.width) * (edges.right - edges.left);
  const pitch = edges.top - (point.y / PAD.height) * (edges.top - edges.bottom);
  return clamp({ pitch_deg: pitch, yaw_deg: yaw }, limits);
}

export function clamp(angles: Angles, limits: AngleLimits): Angles {
  return {
    pitch_deg: Math.min(limits.pitchMax_deg, Math.max(limits.pitchMin_deg, angles.pitch_deg)),
    yaw_deg: Math.min(limits.yawMax_deg, Math.max(limits.yawMin_deg, angles.yaw_deg)),
  };
}

/** Degrees per press of an arrow key. PageUp, PageDown and an arrow key with Shift turn ten times as far. */
const KEY_STEP_DEG = 1;

/** The angles after a key press on the pad, clamped to the limits; null for other keys. */
export function anglesAfterKey(angles: Angles, key: string, shift: boolean, limits: AngleLimits): Angles | null {
  const step = KEY_STEP_DEG * (shift ? 10 : 1);
  const turnedBy = (pitch: number, yaw: number): Angles => clamp({ pitch_deg: angles.pitch_deg + pitch, yaw_deg: angles.yaw_deg + yaw }, limits);
  switch (key) {
    case 'ArrowUp':
      return turnedBy(step, 0);
    case 'ArrowDown':
      return turnedBy(-step, 0);
    case 'ArrowRight':
      return turnedBy(0, step);
    case 'ArrowLeft':
      return turnedBy(0, -step);
    case 'PageUp':
      return turnedBy(10 * KEY_STEP_DEG, 0);
    case 'PageDown':
      return turnedBy(-10 * KEY_STEP_DEG, 0);
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
  const axisText = (value: number, plus: string, minus: string): string => `${Math.abs(Math.round(value))}° ${Math.round(value) < 0 ? minus : plus}`;
  return `${axisText(angles.pitch_deg, 'up', 'down')}, ${axisText(angles.yaw_deg, 'right', 'left')}`;
}

/** Yaw of the camera relative to the vehicle's nose, -180 to 180; null: not known. */
export function cameraYaw_deg(gimbal: Gimbal, vehicleYaw_ned_rad: number | null): number | null {
  let yaw = toDeg(gimbal.yaw_frd_rad);
  if (yaw === null && gimbal.yaw_ned_rad !== null && vehicleYaw_ned_rad !== null) {
    yaw = toDeg(gimbal.yaw_ned_rad - vehicleYaw_ned_rad);
  }
  return yaw === null ? null : ((((yaw + 180) % 360) + 360) % 360) - 180;
}

/** Direction of the camera relative to the vehicle's nose; null if the gimbal reports no pitch. The pad shows an unknown yaw as 0. */
export function cameraDirection(gimbal: Gimbal, vehicleYaw_ned_rad: number | null): Angles | null {
  const pitch = toDeg(gimbal.pitch_rad);
  return pitch === null ? null : { pitch_deg: pitch, yaw_deg: cameraYaw_deg(gimbal, vehicleYaw_ned_rad) ?? 0 };
}

export interface ControlHolder {
  kind: 'server' | 'other' | 'vehicle' | 'nobody';
  text: string;
}

/** MAV_COMP_ID_AUTOPILOT1. */
const AUTOPILOT = 1;

/**
 * @param primaryControl (system id, component id) of the component in control, as the gimbal manager reports it.
 * @param isServerInControl whether this server is in control, as the server reports it.
 */
export function controlHolder(primaryControl: readonly [number, number] | null, isServerInControl: boolean): ControlHolder {
  if (primaryControl === null || (primaryControl[0] === 0 && primaryControl[1] === 0)) return { kind: 'nobody', text: 'not controlled' };
  if (isServerInControl) return { kind: 'server', text: 'controlled by this server' };
  if (primaryControl[1] === AUTOPILOT) return { kind: 'vehicle', text: 'controlled by the vehicle' };
  return { kind: 'other', text: `controlled by system ${primaryControl[0]}, component ${primaryControl[1]}` };
}
