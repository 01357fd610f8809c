/**
 * Every field of every mission item: initial value, label, bounds, and texts of enum values. The types require
 * an entry for each field of the API's items. The meanings are those of MAVLink's common message set and PX4 v1.16. Pure functions.
 */

import type { components } from '../../../api/schema';
import type { Limits } from '../../../vehicle/fields';
import type { Item, ItemKind } from './document';

type ApiItem = components['schemas']['Plan']['items'][number];
/** Kinds with fields of their own; `command` and `complex` are kept unchanged. */
export type EditableKind = Exclude<ItemKind, 'command' | 'complex' | 'pattern'>;
type CommonField = 'kind' | 'autocontinue' | 'spare_params' | 'original' | 'lat_deg' | 'lon_deg' | 'altitude';
type OwnField<K extends EditableKind> = Exclude<keyof Extract<ApiItem, { kind: K }>, CommonField>;

export interface FieldSpec {
  /** Value in a new item; null is sent as NaN. */
  readonly initial: number | null;
  /** null: the field is not shown and is kept unchanged. */
  readonly label: string | null;
  /** Bounds of PX4 and MAVLink, which the API does not check. */
  readonly limits?: Limits;
  readonly step?: number;
  /** Whether only whole numbers are permitted. */
  readonly integer?: boolean;
  /** The field may be empty; this text then describes the value that applies. */
  readonly placeholder?: string;
  /** Texts of the enum values. */
  readonly options?: Readonly<Record<string, string>>;
  /** Unit, if the name of the field does not give it. */
  readonly unit?: (item: Item) => string;
  /** Whether the field applies to an item, depending on the other fields. */
  readonly appliesTo?: (item: Item) => boolean;
}

type FieldDetails = Omit<FieldSpec, 'initial' | 'label'>;

const field = (initial: number | null, label: string, details: FieldDetails = {}): FieldSpec => ({ initial, label, ...details });
/** A field that PX4 does not use on a multicopter. */
const hiddenField = (initial: number | null): FieldSpec => ({ initial, label: null });
const choice = (initial: number, label: string, options: Readonly<Record<string, string>>, details: FieldDetails = {}): FieldSpec => ({
  initial,
  label,
  options,
  ...details,
});
const isOneOf =
  (name: string, ...values: readonly number[]) =>
  (item: Item): boolean =>
    values.includes(Number(item[name]));

const ID_RANGE = { limits: { min: 0, max: 255 }, integer: true };
const camera = field(0, 'Camera (0: all)', ID_RANGE);
const gimbal = field(0, 'Gimbal (0: all)', ID_RANGE);
const stream = field(0, 'Video stream (0: all)', ID_RANGE);
const shutter = field(0, 'Shutter time (0 or −1: set by the camera)', { limits: { min: -1 } });
const holdTime = (initial: number) => field(initial, 'Hold for', { limits: { min: 0 } });
const yaw = field(null, 'Yaw from north', { placeholder: 'automatic' });
const ANGLE_RANGE = { limits: { min: -360, max: 360 } };
const INTEGER_ANGLE_RANGE = { limits: { min: -180, max: 180 }, integer: true };
const UNCHANGED_IF_EMPTY = { placeholder: 'unchanged' };

const YES_NO = { 0: 'no', 1: 'yes' };
const YES_NO_UNCHANGED = { ...YES_NO, '-1': 'unchanged' };
const VIDEO = { 0: 'off', 1: 'compressed', 2: 'raw' };
const CAMERA_MODES = { 0: 'photos', 1: 'video', 2: 'survey photos' };
const ZOOM_TYPES = { 0: 'step', 1: 'continuous', 2: 'percent of the range', 3: 'focal length', 4: 'field of view' };
const FOCUS_TYPES = {
  0: 'step',
  1: 'continuous',
  2: 'percent of the range',
  3: 'distance',
  4: 'automatic',
  5: 'automatic, once',
  6: 'automatic, continuous',
};
const MOUNT_MODES = { 0: 'retract', 1: 'neutral', 2: 'angles', 3: 'RC control', 4: 'position', 5: 'follow a system', 6: 'home' };
const WINCH_ACTIONS = {
  0: 'relax',
  1: 'move by a length',
  2: 'move at a rate',
  3: 'lock',
  4: 'deliver',
  5: 'hold',
  6: 'retract',
  7: 'load line',
  8: 'abandon line',
  9: 'load payload',
};
const GIMBAL_CONTROL = { '-2': 'the vehicle', '-1': 'unchanged', 0: 'not controlled' };
const SYSTEMS = { ...GIMBAL_CONTROL, 1: 'system 1', 255: 'ground station (255)' };
const COMPONENTS = { ...GIMBAL_CONTROL, 1: 'autopilot (1)', 190: 'ground station (190)', 191: 'onboard computer (191)' };
/** Sums of GIMBAL_MANAGER_FLAGS: 4 roll lock, 8 pitch lock, 16 yaw lock. */
const GIMBAL_FLAGS = { 0: 'vehicle', 12: 'vehicle heading, horizon', 16: 'north', 28: 'north, horizon' };

export const ITEM_FIELDS: { readonly [K in EditableKind]: { readonly [F in OwnField<K>]-?: FieldSpec } } = {
  takeoff: { pitch_deg: hiddenField(0), yaw_ned_deg: yaw },
  waypoint: {
    hold_s: holdTime(0),
    acceptance_radius_m: field(0, 'Acceptance radius', { limits: { min: 0 } }),
    pass_radius_m: field(0, 'Pass radius (negative: counter-clockwise)'),
    yaw_ned_deg: yaw,
  },
  loiter_unlimited: { radius_m: hiddenField(0), yaw_ned_deg: yaw },
  loiter_time: { hold_s: holdTime(10), radius_m: hiddenField(0), exit_xtrack: hiddenField(0) },
  loiter_to_altitude: { leave_towards_next: hiddenField(0), radius_m: hiddenField(0), exit_xtrack: hiddenField(0) },
  land: {
    abort_altitude_m: hiddenField(0),
    precision: choice(0, 'Precision landing', { 0: 'off', 1: 'if a target is visible', 2: 'required' }),
    yaw_ned_deg: yaw,
  },
  roi_location: { gimbal_id: gimbal },
  // For an item with a position, PX4 accepts only these two modes.
  roi: { mode: choice(3, 'Mode', { 3: 'look at the position', 0: 'clear' }), target: hiddenField(0), index: hiddenField(0) },
  gate: { geometry: hiddenField(0), use_altitude: hiddenField(0) },
  return_home: {},
  delay: {
    delay_s: field(5, 'Wait for (−1: until a UTC time)', { limits: { min: -1 } }),
    hour_utc: field(0, 'Until, hour UTC (−1: any)', { limits: { min: -1, max: 23 }, integer: true, appliesTo: (item) => Number(item['delay_s']) < 0 }),
    minute_utc: field(0, 'Until, minute UTC (−1: any)', { limits: { min: -1, max: 59 }, integer: true, appliesTo: (item) => Number(item['delay_s']) < 0 }),
    second_utc: field(0, 'Until, second UTC (−1: any)', { limits: { min: -1, max: 59 }, integer: true, appliesTo: (item) => Number(item['delay_s']) < 0 }),
  },
  jump: {
    target_index: field(0, 'Target item', { limits: { min: 1, max: 100_001 }, integer: true }),
    repeat: field(1, 'Repeats (−1: endless)', { limits: { min: -1, max: 65_535 }, integer: true }),
  },
  change_speed: {
    speed_type: choice(1, 'Speed type', { 1: 'ground speed', 2: 'climb speed', 3: 'descent speed', 0: 'airspeed' }),
    speed_m_s: field(5, 'Speed (−1: unchanged, −2: default)', { limits: { min: -2, max: 1000 } }),
    throttle_percent: hiddenField(-1),
  },
  // PX4 accepts only the vehicle's position; the field is shown only if the item has another value.
  set_home: { use_current: choice(1, 'New home', { 1: 'vehicle’s position' }, { appliesTo: (item) => item['use_current'] !== 1 }) },
  land_start: {},
  roi_next_waypoint: {
    gimbal_id: gimbal,
    pitch_offset_deg: field(0, 'Pitch offset', INTEGER_ANGLE_RANGE),
    roll_offset_deg: field(0, 'Roll offset', INTEGER_ANGLE_RANGE),
    yaw_offset_deg: field(0, 'Yaw offset', ANGLE_RANGE),
  },
  roi_none: { gimbal_id: gimbal },
  set_servo: { servo: field(1, 'Servo', ID_RANGE), pulse_us: field(1500, 'Pulse width', { limits: { min: 0, max: 65_535 } }) },
  set_actuator: {
    actuator_1: field(null, 'Actuator 1, −1 to 1', { limits: { min: -1, max: 1 }, step: 0.1, ...UNCHANGED_IF_EMPTY }),
    actuator_2: field(null, 'Actuator 2, −1 to 1', { limits: { min: -1, max: 1 }, step: 0.1, ...UNCHANGED_IF_EMPTY }),
    actuator_3: field(null, 'Actuator 3, −1 to 1', { limits: { min: -1, max: 1 }, step: 0.1, ...UNCHANGED_IF_EMPTY }),
    actuator_4: field(null, 'Actuator 4, −1 to 1', { limits: { min: -1, max: 1 }, step: 0.1, ...UNCHANGED_IF_EMPTY }),
    // PX4 has only the actuator set 0.
    set_index: field(0, 'Actuator set', { ...ID_RANGE, appliesTo: (item) => item['set_index'] !== 0 }),
  },
  gripper: { gripper: field(1, 'Gripper', { ...ID_RANGE, limits: { min: 1, max: 255 } }), action: choice(0, 'Action', { 0: 'open', 1: 'close' }) },
  winch: {
    winch: field(1, 'Winch', { ...ID_RANGE, limits: { min: 1, max: 255 } }),
    action: choice(4, 'Action', WINCH_ACTIONS),
    length_m: field(0, 'Line to release (negative: wind in)', { appliesTo: isOneOf('action', 1) }),
    rate_m_s: field(0, 'Release rate (negative: wind in)', { appliesTo: isOneOf('action', 1, 2) }),
  },
  trigger_distance: {
    distance_m: field(10, 'Distance (0: stop)', { limits: { min: 0 } }),
    shutter_ms: shutter,
    at_once: choice(1, 'First photo', { 1: 'immediately', 0: 'after this distance' }),
    camera,
  },
  trigger_interval: { interval_ms: field(1000, 'Time between photos (0 or −1: unchanged)', { limits: { min: -1 } }), shutter_ms: shutter, camera },
  trigger_control: {
    enable: choice(1, 'Trigger', { 1: 'start', 0: 'stop', '-1': 'unchanged' }),
    reset: choice(0, 'Restart the sequence', YES_NO_UNCHANGED),
    pause: choice(0, 'Pause', YES_NO_UNCHANGED),
    camera,
  },
  photo_start: {
    interval_s: field(0, 'Interval', { limits: { min: 0 } }),
    count: field(1, 'Photos (0: until stopped)', { limits: { min: 0 }, integer: true }),
    camera,
    sequence: hiddenField(0),
  },
  photo_stop: { camera },
  video_start: { stream, status_hz: field(0, 'Status messages (0: none)', { limits: { min: 0 } }), camera },
  video_stop: { stream, camera },
  camera_mode: { mode: choice(0, 'Mode', CAMERA_MODES), camera },
  camera_zoom: {
    zoom_type: choice(2, 'Zoom by', ZOOM_TYPES),
    value: field(0, 'Zoom', { unit: (item) => ({ 2: '%', 3: 'mm', 4: '°' })[Number(item['zoom_type'])] ?? '' }),
    camera,
  },
  camera_focus: {
    focus_type: choice(4, 'Focus by', FOCUS_TYPES),
    value: field(0, 'Focus', { appliesTo: isOneOf('focus_type', 0, 1, 2, 3), unit: (item) => ({ 2: '%', 3: 'length' })[Number(item['focus_type'])] ?? '' }),
    camera,
  },
  control_video: {
    transmission: choice(0, 'Transmission', VIDEO),
    interval_s: field(0, 'Time between photos (0: video)', { limits: { min: 0 } }),
    recording: choice(1, 'Recording', VIDEO),
    camera,
  },
  digicam: {
    shoot: choice(1, 'Take a photo', YES_NO),
    shot_id: choice(0, 'Test photo, not counted', YES_NO),
    session: hiddenField(0),
    zoom: hiddenField(0),
    zoom_step: hiddenField(0),
    focus_lock: hiddenField(0),
    command_id: hiddenField(0),
  },
  oblique_survey: {
    distance_m: field(10, 'Distance (0: stop)', { limits: { min: 0 } }),
    interval_ms: field(0, 'Minimum time between photos', { limits: { min: 0 }, integer: true }),
    positions: field(3, 'Number of camera positions', { limits: { min: 0, max: 100 }, integer: true }),
    roll_deg: field(30, 'Roll to each side', INTEGER_ANGLE_RANGE),
    pitch_deg: field(-90, 'Pitch', INTEGER_ANGLE_RANGE),
    shutter_ms: shutter,
  },
  gimbal_pitch_yaw: {
    pitch_deg: field(-90, 'Pitch', { ...ANGLE_RANGE, ...UNCHANGED_IF_EMPTY }),
    yaw_deg: field(0, 'Yaw', { ...ANGLE_RANGE, ...UNCHANGED_IF_EMPTY }),
    flags: choice(0, 'Angles relative to', GIMBAL_FLAGS),
    pitch_rate_deg_s: field(null, 'Pitch rate', { placeholder: 'default' }),
    yaw_rate_deg_s: field(null, 'Yaw rate', { placeholder: 'default' }),
    gimbal_id: gimbal,
  },
  gimbal_configure: {
    primary_system: choice(-2, 'Primary control, system', SYSTEMS),
    primary_component: choice(-2, 'Primary control, component', COMPONENTS),
    secondary_system: choice(0, 'Secondary control, system', SYSTEMS),
    secondary_component: choice(0, 'Secondary control, component', COMPONENTS),
    gimbal_id: gimbal,
  },
  mount_configure: {
    mode: choice(2, 'Mode', MOUNT_MODES),
    stabilize_roll: choice(1, 'Stabilize roll', YES_NO),
    stabilize_pitch: choice(1, 'Stabilize pitch', YES_NO),
    stabilize_yaw: choice(0, 'Stabilize yaw', YES_NO),
  },
  mount_control: {
    mode: choice(2, 'Mode', MOUNT_MODES),
    pitch_deg: field(0, 'Pitch', ANGLE_RANGE),
    roll_deg: field(0, 'Roll', ANGLE_RANGE),
    yaw_deg: field(0, 'Yaw', ANGLE_RANGE),
  },
};

/** The fields of a kind in the order of the editor; none for items that are kept unchanged. */
export function specsOf(kind: ItemKind): [string, FieldSpec][] {
  return Object.entries((ITEM_FIELDS as Readonly<Partial<Record<ItemKind, Readonly<Record<string, FieldSpec>>>>>)[kind] ?? {});
}

/** Text of an enum value; null if the field has no texts. */
export function optionText(item: Item, name: string): string | null {
  const options = specsOf(item.kind).find(([field]) => field === name)?.[1].options;
  const value = item[name];
  return options === undefined ? null : (options[String(value)] ?? (typeof value === 'number' ? `other (${value})` : 'not set'));
}
