/**
 * Every kind of setpoint as a form: the names, frames and units of its fields, and their conversion to the API's
 * values. In the form, up is positive and angles are in degrees; the API has down and radians.
 */

export type SetpointKind =
  | 'position'
  | 'position_global'
  | 'position_body'
  | 'velocity'
  | 'velocity_body'
  | 'acceleration'
  | 'trajectory'
  | 'attitude'
  | 'rates'
  | 'follow'
  | 'thrust_torque'
  | 'actuators';

export interface Axis {
  /** Unique within its kind. */
  key: string;
  label: string;
  unit: string;
  /** API value = typed value × scale. */
  scale: number;
  min?: number;
  max?: number;
  step: number;
}

export interface Group {
  /** Name in the API. */
  field: string;
  title: string;
  axes: readonly Axis[];
  /** An axis may be null: this quantity does not control it. North and east are null together. One quantity must control each axis. */
  nullable: boolean;
  /** The whole quantity may be missing. */
  optional: boolean;
  /** One number instead of an array. */
  scalar?: boolean;
}

/** How the form sets the yaw. */
export type YawInput = 'angle_or_rate' | 'offset' | 'follow' | 'none';

export interface KindSpec {
  kind: SetpointKind;
  name: string;
  frame: string;
  /** Warning about what this kind does not control; shown in the list of kinds. */
  warning: string | null;
  groups: readonly Group[];
  yaw: YawInput;
}

const RAD = Math.PI / 180;
const NOT_HELD = 'Altitude and position are not held: the vehicle drifts, climbs or descends.';

function axes(
  prefix: string,
  labels: readonly [string, string, string],
  unit: string,
  step: number,
  scales: readonly [number, number, number] = [1, 1, 1],
): Axis[] {
  return labels.map((label, i) => ({ key: `${prefix}${i}`, label, unit, step, scale: scales[i] ?? 1 }));
}

const NEU: readonly [string, string, string] = ['North', 'East', 'Up'];
const FRU: readonly [string, string, string] = ['Forward', 'Right', 'Up'];
const UP: readonly [number, number, number] = [1, 1, -1];

function group(field: string, title: string, list: readonly Axis[], more: Partial<Group> = {}): Group {
  return { field, title, axes: list, nullable: false, optional: false, ...more };
}

const THRUST = group('thrust', 'Thrust', [{ key: 'thrust', label: 'Thrust', unit: '', scale: 1, min: 0, max: 1, step: 0.01 }], { scalar: true });

const POSITION = group('position_ned_m', 'Position', axes('p', NEU, 'm', 0.5, UP));
const VELOCITY = group('velocity_ned_m_s', 'Velocity', axes('v', NEU, 'm/s', 0.1, UP));
const ACCELERATION = group('acceleration_ned_m_s2', 'Acceleration', axes('a', NEU, 'm/s²', 0.1, UP));

export const KINDS: readonly KindSpec[] = [
  { kind: 'position', name: 'Position', frame: 'local frame, from the origin', warning: null, groups: [POSITION], yaw: 'angle_or_rate' },
  {
    kind: 'position_global',
    name: 'Global position',
    frame: 'WGS 84',
    warning: null,
    yaw: 'angle_or_rate',
    groups: [
      group('lat_deg', 'Latitude', [{ key: 'lat', label: 'Latitude', unit: '°', scale: 1, min: -90, max: 90, step: 0.00001 }], { scalar: true }),
      group('lon_deg', 'Longitude', [{ key: 'lon', label: 'Longitude', unit: '°', scale: 1, min: -180, max: 180, step: 0.00001 }], { scalar: true }),
      group('alt', 'Altitude', [{ key: 'alt', label: 'Altitude', unit: 'm', scale: 1, step: 0.5 }], { scalar: true }),
    ],
  },
  {
    kind: 'position_body',
    name: 'Offset',
    frame: 'from the current position, along the heading',
    warning: null,
    groups: [group('offset_frd_m', 'Offset', axes('o', FRU, 'm', 0.5, UP))],
    yaw: 'offset',
  },
  {
    kind: 'velocity',
    name: 'Velocity',
    frame: 'local, north east up',
    warning: 'The vehicle keeps moving until the setpoint changes or expires.',
    groups: [VELOCITY],
    yaw: 'angle_or_rate',
  },
  {
    kind: 'velocity_body',
    name: 'Velocity along heading',
    frame: 'forward, right, up',
    warning: 'The vehicle keeps moving until the setpoint changes or expires.',
    groups: [group('velocity_frd_m_s', 'Velocity', axes('w', FRU, 'm/s', 0.1, UP))],
    yaw: 'angle_or_rate',
  },
  {
    kind: 'acceleration',
    name: 'Acceleration',
    frame: 'local, north east up',
    warning: 'The speed grows for as long as the setpoint is valid.',
    groups: [ACCELERATION],
    yaw: 'angle_or_rate',
  },
  {
    kind: 'trajectory',
    name: 'Trajectory point',
    frame: 'local: position, velocity, acceleration',
    warning: null,
    yaw: 'angle_or_rate',
    groups: [
      { ...POSITION, nullable: true },
      { ...VELOCITY, title: 'Velocity (or feed-forward)', nullable: true, optional: true },
      { ...ACCELERATION, title: 'Acceleration (or feed-forward)', nullable: true, optional: true },
    ],
  },
  {
    kind: 'attitude',
    name: 'Attitude',
    frame: 'relative to the horizon',
    warning: NOT_HELD,
    yaw: 'none',
    groups: [
      group('roll_rad', 'Roll', [{ key: 'roll', label: 'Roll (+ right)', unit: '°', scale: RAD, min: -180, max: 180, step: 1 }], { scalar: true }),
      group('pitch_rad', 'Pitch', [{ key: 'pitch', label: 'Pitch (+ up)', unit: '°', scale: RAD, min: -90, max: 90, step: 1 }], { scalar: true }),
      group('yaw_ned_rad', 'Yaw', [{ key: 'yaw', label: 'Yaw, from north', unit: '°', scale: RAD, min: -360, max: 360, step: 5 }], { scalar: true }),
      THRUST,
      group('yaw_rate_ned_rad_s', 'Yaw rate', [{ key: 'rate', label: 'Yaw rate', unit: '°/s', scale: RAD, step: 5 }], { scalar: true, optional: true }),
    ],
  },
  {
    kind: 'rates',
    name: 'Body rates',
    frame: 'about the body axes',
    warning: 'The vehicle is not levelled: it keeps rotating. ' + NOT_HELD,
    yaw: 'none',
    groups: [
      group('rates_frd_rad_s', 'Rates', [
        { key: 'r0', label: 'Roll (+ right)', unit: '°/s', scale: RAD, step: 5 },
        { key: 'r1', label: 'Pitch (+ up)', unit: '°/s', scale: RAD, step: 5 },
        { key: 'r2', label: 'Yaw (+ clockwise)', unit: '°/s', scale: RAD, step: 5 },
      ]),
      THRUST,
    ],
  },
  {
    kind: 'follow',
    name: 'Follow a vehicle',
    frame: 'at an offset along the other vehicle’s heading',
    warning: null,
    groups: [group('offset_frd_m', 'Offset from the other vehicle', axes('o', FRU, 'm', 0.5, UP))],
    yaw: 'follow',
  },
  {
    kind: 'thrust_torque',
    name: 'Thrust and torque',
    frame: 'body axes, −1 to 1',
    warning: NOT_HELD,
    yaw: 'none',
    groups: [
      group(
        'thrust_frd',
        'Thrust',
        axes('f', FRU, '', 0.01, UP).map((a) => ({ ...a, min: -1, max: 1 })),
      ),
      group(
        'torque_frd',
        'Torque',
        axes('t', ['Roll', 'Pitch', 'Yaw'], '', 0.01).map((a) => ({ ...a, min: -1, max: 1 })),
      ),
    ],
  },
  { kind: 'actuators', name: 'Motors and servos', frame: 'each individually', warning: NOT_HELD, groups: [], yaw: 'none' },
];

export function specOf(kind: SetpointKind): KindSpec {
  const spec = KINDS.find((k) => k.kind === kind);
  if (spec === undefined) throw new Error(`unknown kind ${kind}`);
  return spec;
}

/** "Velocity along heading" for the server's name of a kind; an unknown kind keeps its name. */
export function kindName(type: string | null): string {
  return KINDS.find((k) => k.kind === type)?.name ?? type ?? 'setpoints';
}
