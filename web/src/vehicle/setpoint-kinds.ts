/**
 * The input form for each setpoint type: names, frames and units of the fields, and the scales to the API's values. In the form
 * up is positive and angles are in degrees; in the API down is positive and angles are in radians.
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
  /** Unique within its setpoint type. */
  key: string;
  label: string;
  unit: string;
  /** API value = typed value × scale. */
  scale: number;
  min?: number;
  max?: number;
  step: number;
}

/** A quantity of a setpoint, such as the velocity, with its axes. */
export interface SetpointQuantity {
  /** Name in the API. */
  field: string;
  title: string;
  axes: readonly Axis[];
  /**
   * An axis may be null: this quantity does not control the axis. North and east are null together. At least one quantity
   * controls each axis.
   */
  nullable: boolean;
  /** The setpoint may omit the whole quantity. */
  optional: boolean;
  /** The API's value is a number instead of an array. */
  scalar?: boolean;
}

/** How the form sets the yaw. */
export type YawInput = 'angle_or_rate' | 'offset' | 'follow' | 'none';

export interface KindSpec {
  kind: SetpointKind;
  name: string;
  frame: string;
  /** Warning about motion that this setpoint type does not control. */
  warning: string | null;
  quantities: readonly SetpointQuantity[];
  yaw: YawInput;
}

const RAD = Math.PI / 180;
const NOT_CONTROLLED = 'Altitude and position are not controlled: the vehicle drifts, climbs or descends.';

/** Quantities (`ui/units.ts`) of the axis Up. */
const VERTICAL: Readonly<Record<string, string>> = { length: 'height', speed: 'climb' };

function axes(
  prefix: string,
  labels: readonly [string, string, string],
  unit: string,
  step: number,
  scales: readonly [number, number, number] = [1, 1, 1],
): Axis[] {
  return labels.map((label, i) => ({ key: `${prefix}${i}`, label, unit: (i === 2 ? VERTICAL[unit] : undefined) ?? unit, step, scale: scales[i] ?? 1 }));
}

const NEU: readonly [string, string, string] = ['North', 'East', 'Up'];
const FRU: readonly [string, string, string] = ['Forward', 'Right', 'Up'];
/** Scales of the axes: the form's third axis is up, the API's is down. */
const UP_TO_DOWN: readonly [number, number, number] = [1, 1, -1];

function quantity(field: string, title: string, quantityAxes: readonly Axis[], options: Partial<SetpointQuantity> = {}): SetpointQuantity {
  return { field, title, axes: quantityAxes, nullable: false, optional: false, ...options };
}

const THRUST = quantity('thrust', 'Thrust', [{ key: 'thrust', label: 'Thrust (0 to 1)', unit: '', scale: 1, min: 0, max: 1, step: 0.01 }], { scalar: true });

const POSITION = quantity('position_ned_m', 'Position', axes('p', NEU, 'length', 0.5, UP_TO_DOWN));
const VELOCITY = quantity('velocity_ned_m_s', 'Velocity', axes('v', NEU, 'speed', 0.1, UP_TO_DOWN));
const ACCELERATION = quantity('acceleration_ned_m_s2', 'Acceleration', axes('a', NEU, 'm/s²', 0.1, UP_TO_DOWN));

export const KINDS: readonly KindSpec[] = [
  { kind: 'position', name: 'Position', frame: 'local frame, from the origin', warning: null, quantities: [POSITION], yaw: 'angle_or_rate' },
  {
    kind: 'position_global',
    name: 'Global position',
    frame: 'WGS 84',
    warning: null,
    yaw: 'angle_or_rate',
    quantities: [
      quantity('lat_deg', 'Latitude', [{ key: 'lat', label: 'Latitude', unit: '°', scale: 1, min: -90, max: 90, step: 0.00001 }], { scalar: true }),
      quantity('lon_deg', 'Longitude', [{ key: 'lon', label: 'Longitude', unit: '°', scale: 1, min: -180, max: 180, step: 0.00001 }], { scalar: true }),
      quantity('alt', 'Altitude', [{ key: 'alt', label: 'Altitude', unit: 'height', scale: 1, step: 0.5 }], { scalar: true }),
    ],
  },
  {
    kind: 'position_body',
    name: 'Offset',
    frame: 'from the current position, along the heading',
    warning: null,
    quantities: [quantity('offset_frd_m', 'Offset', axes('o', FRU, 'length', 0.5, UP_TO_DOWN))],
    yaw: 'offset',
  },
  {
    kind: 'velocity',
    name: 'Velocity',
    frame: 'local frame: north, east, up',
    warning: 'The vehicle keeps moving until the setpoint changes or expires.',
    quantities: [VELOCITY],
    yaw: 'angle_or_rate',
  },
  {
    kind: 'velocity_body',
    name: 'Velocity along heading',
    frame: 'forward, right, up',
    warning: 'The vehicle keeps moving until the setpoint changes or expires.',
    quantities: [quantity('velocity_frd_m_s', 'Velocity', axes('w', FRU, 'speed', 0.1, UP_TO_DOWN))],
    yaw: 'angle_or_rate',
  },
  {
    kind: 'acceleration',
    name: 'Acceleration',
    frame: 'local frame: north, east, up',
    warning: 'The speed grows for as long as the setpoint is valid.',
    quantities: [ACCELERATION],
    yaw: 'angle_or_rate',
  },
  {
    kind: 'trajectory',
    name: 'Trajectory point',
    frame: 'local frame, from the origin: position, velocity, acceleration',
    warning: null,
    yaw: 'angle_or_rate',
    quantities: [
      { ...POSITION, nullable: true },
      { ...VELOCITY, title: 'Velocity (feed-forward if a position is given)', nullable: true, optional: true },
      { ...ACCELERATION, title: 'Acceleration (feed-forward if a position or velocity is given)', nullable: true, optional: true },
    ],
  },
  {
    kind: 'attitude',
    name: 'Attitude',
    frame: 'relative to the horizon',
    warning: NOT_CONTROLLED,
    yaw: 'none',
    quantities: [
      quantity('roll_rad', 'Roll', [{ key: 'roll', label: 'Roll (+ right)', unit: '°', scale: RAD, min: -180, max: 180, step: 1 }], { scalar: true }),
      quantity('pitch_rad', 'Pitch', [{ key: 'pitch', label: 'Pitch (+ up)', unit: '°', scale: RAD, min: -90, max: 90, step: 1 }], { scalar: true }),
      quantity('yaw_ned_rad', 'Yaw', [{ key: 'yaw', label: 'Yaw, from north', unit: '°', scale: RAD, min: -360, max: 360, step: 5 }], { scalar: true }),
      THRUST,
      quantity('yaw_rate_ned_rad_s', 'Yaw rate', [{ key: 'rate', label: 'Yaw rate', unit: '°/s', scale: RAD, step: 5 }], { scalar: true, optional: true }),
    ],
  },
  {
    kind: 'rates',
    name: 'Body rates',
    frame: 'about the body axes',
    warning: 'The vehicle is not levelled: it keeps rotating. ' + NOT_CONTROLLED,
    yaw: 'none',
    quantities: [
      quantity('rates_frd_rad_s', 'Rates', [
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
    quantities: [quantity('offset_frd_m', 'Offset from the other vehicle', axes('o', FRU, 'length', 0.5, UP_TO_DOWN))],
    yaw: 'follow',
  },
  {
    kind: 'thrust_torque',
    name: 'Thrust and torque',
    frame: 'body axes, −1 to 1',
    warning: NOT_CONTROLLED,
    yaw: 'none',
    quantities: [
      quantity(
        'thrust_frd',
        'Thrust',
        axes('f', FRU, '', 0.01, UP_TO_DOWN).map((a) => ({ ...a, min: -1, max: 1 })),
      ),
      quantity(
        'torque_frd',
        'Torque',
        axes('t', ['Roll', 'Pitch', 'Yaw'], '', 0.01).map((a) => ({ ...a, min: -1, max: 1 })),
      ),
    ],
  },
  { kind: 'actuators', name: 'Motors and servos', frame: 'each output individually', warning: NOT_CONTROLLED, quantities: [], yaw: 'none' },
];

export function specOf(kind: SetpointKind): KindSpec {
  const spec = KINDS.find((k) => k.kind === kind);
  if (spec === undefined) throw new Error(`Unknown setpoint type ${kind}.`);
  return spec;
}

/** Displayed name of a setpoint type, for example "Velocity along heading" for `velocity_body`; an unknown type keeps its name. */
export function kindName(type: string | null): string {
  if (type === 'follow_device') return 'Follow a device'; // has no form: a device sends it
  return KINDS.find((k) => k.kind === type)?.name ?? type ?? 'setpoints';
}

/** The setpoints of a stream, for example "Position setpoints", which is not the flight mode Position. */
export function setpointsText(type: string | null): string {
  return type === null ? 'Setpoints' : `${kindName(type)} setpoints`;
}
