/**
 * Target and actual values of the last minute for the plots, by quantity and axis. The time of a sample is the time at
 * which the page received it.
 */

import type { Attitude, LocalPosition, MaybeVector3, Vector3 } from '../../../live/topics';
import type { OffboardStatus } from '../../../vehicle/offboard';
import { bodyToNed } from './preview';

export const WINDOW_S = 60;
/** A longer time without a sample [s] is drawn as a gap. */
const GAP_S = 2;
/** Capacity for one minute at up to 30 samples a second. */
const MAX_ROWS = 60 * 30;
const DEG_PER_RAD = 180 / Math.PI;

export type PlottedQuantity = 'position' | 'velocity' | 'attitude';

export interface AxisSpec {
  name: string;
  /** A text, or a quantity of `ui/units.ts`. */
  unit: string;
}

export const PLOTTED_QUANTITIES: Readonly<Record<PlottedQuantity, { name: string; axes: readonly [AxisSpec, AxisSpec, AxisSpec] }>> = {
  position: {
    name: 'Position',
    axes: [
      { name: 'North', unit: 'length' },
      { name: 'East', unit: 'length' },
      { name: 'Up', unit: 'height' },
    ],
  },
  velocity: {
    name: 'Velocity',
    axes: [
      { name: 'North', unit: 'speed' },
      { name: 'East', unit: 'speed' },
      { name: 'Up', unit: 'climb' },
    ],
  },
  attitude: {
    name: 'Attitude',
    axes: [
      { name: 'Roll', unit: '°' },
      { name: 'Pitch', unit: '°' },
      { name: 'Yaw', unit: '°' },
    ],
  },
};

/** Columns of one plot: time, target, actual; null is a gap. */
export type Columns = [number[], (number | null)[], (number | null)[]];

interface Row {
  unix_s: number;
  target: MaybeVector3;
  actual: MaybeVector3;
}

export interface TelemetrySample {
  unix_s: number;
  local: LocalPosition | null;
  attitude: Attitude | null;
  /** The current target; null while the server streams no setpoints. */
  target: Target | null;
}

export interface Target {
  position_ned_m: MaybeVector3 | null;
  velocity_ned_m_s: MaybeVector3 | null;
  /** Roll, pitch, yaw. */
  attitude_rad: MaybeVector3 | null;
}

const NO_VALUES: MaybeVector3 = [null, null, null];

function downToUp(v: Readonly<MaybeVector3> | null): MaybeVector3 {
  return v === null ? NO_VALUES : [v[0], v[1], v[2] === null ? null : 0 - v[2]];
}

function toDegrees(v: MaybeVector3): MaybeVector3 {
  return v.map((a) => (a === null ? null : a * DEG_PER_RAD)) as MaybeVector3;
}

export class Traces {
  /** Incremented by each change, so that the plots are drawn again only after a change. */
  revision = 0;
  private rows: Readonly<Record<PlottedQuantity, Row[]>> = { position: [], velocity: [], attitude: [] };

  clear(): void {
    this.rows = { position: [], velocity: [], attitude: [] };
    this.revision += 1;
  }

  add(sample: TelemetrySample): void {
    const { local, attitude, target, unix_s } = sample;
    this.push('position', unix_s, downToUp(target?.position_ned_m ?? null), downToUp(local?.position_ned_m ?? null));
    this.push('velocity', unix_s, downToUp(target?.velocity_ned_m_s ?? null), downToUp(local?.velocity_ned_m_s ?? null));
    const actual_rad: MaybeVector3 = attitude === null ? NO_VALUES : [attitude.roll_rad, attitude.pitch_rad, attitude.yaw_ned_rad];
    this.push('attitude', unix_s, toDegrees(target?.attitude_rad ?? NO_VALUES), toDegrees(actual_rad));
    this.revision += 1;
  }

  /** The columns of one axis; the times are relative to `now_unix_s`: −60 to 0 s. */
  columns(quantity: PlottedQuantity, axis: 0 | 1 | 2, now_unix_s: number): Columns {
    const windowStart_unix_s = now_unix_s - WINDOW_S;
    const rows = this.rows[quantity].filter((r) => r.unix_s >= windowStart_unix_s);
    const isYaw = quantity === 'attitude' && axis === 2;
    return [
      rows.map((r) => r.unix_s - now_unix_s),
      withYawGaps(
        rows.map((r) => r.target[axis]),
        isYaw,
      ),
      withYawGaps(
        rows.map((r) => r.actual[axis]),
        isYaw,
      ),
    ];
  }

  private push(quantity: PlottedQuantity, unix_s: number, target: MaybeVector3, actual: MaybeVector3): void {
    const rows = this.rows[quantity];
    const last = rows.at(-1);
    if (last !== undefined && unix_s <= last.unix_s) return;
    if (last !== undefined && unix_s - last.unix_s > GAP_S) rows.push({ unix_s: last.unix_s + GAP_S / 2, target: NO_VALUES, actual: NO_VALUES });
    rows.push({ unix_s, target, actual });
    if (rows.length > MAX_ROWS) rows.splice(0, rows.length - MAX_ROWS);
  }
}

/** The values; for yaw, with a gap where the yaw jumps between 180° and −180°. */
function withYawGaps(values: (number | null)[], isYaw: boolean): (number | null)[] {
  if (!isYaw) return values;
  return values.map((v, i) => {
    const previous = values[i - 1];
    return v !== null && previous != null && Math.abs(v - previous) > 180 ? null : v;
  });
}

/** Roll, pitch and yaw [rad] of an attitude quaternion (FRD to NED). */
export function eulerOf(q: readonly number[]): MaybeVector3 {
  const [w = 1, x = 0, y = 0, z = 0] = q;
  return [
    Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
    Math.asin(Math.max(-1, Math.min(1, 2 * (w * y - z * x)))),
    Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
  ];
}

/** The target for the plots: position and velocity in NED, attitude. @param yaw_rad the vehicle's yaw, to rotate a body velocity to NED. */
export function targetOf(stream: OffboardStatus | null, setpoint: Readonly<Record<string, unknown>> | null, yaw_rad: number | null = null): Target | null {
  if (stream === null || !stream.streaming) return null;
  const q = setpoint?.['q_ned_frd'];
  const attitude_rad: MaybeVector3 = Array.isArray(q) && q.length === 4 ? eulerOf(q as number[]) : [null, null, stream.yaw_ned_rad];
  const bodyVelocity_m_s = stream.velocity_frd_m_s;
  const rotatedVelocity_ned_m_s =
    bodyVelocity_m_s === null || bodyVelocity_m_s === undefined || yaw_rad === null || bodyVelocity_m_s.some((v) => v === null)
      ? null
      : bodyToNed(bodyVelocity_m_s as Vector3, yaw_rad);
  return { position_ned_m: stream.position_ned_m, velocity_ned_m_s: stream.velocity_ned_m_s ?? rotatedVelocity_ned_m_s, attitude_rad };
}
