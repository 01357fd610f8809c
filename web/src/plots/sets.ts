/** Sets of plots for the usual questions. Each set names fields of PX4's topics and of MAVLink's messages; a log shows those that it has. */

import type { components } from '../api/schema';

type Topic = components['schemas']['LogTopic'];

/** Wanted fields of one pane, as `topic/field`, or an expression with fields in braces. The first alternative of which the log has a field is shown. */
type WantedPane = readonly (readonly string[])[];

/** Series whose field begins like this are of a rerun, not of the log; the rest is their label. */
export const RERUN = 'rerun/';

export interface PlotSet {
  readonly title: string;
  readonly panes: readonly WantedPane[];
  /** The last panes, as many, are shown by frequency where that is possible. */
  readonly spectra?: number;
}

const attitude = (angle: string): string => `${angle}({vehicle_attitude/q[0]}, {vehicle_attitude/q[1]}, {vehicle_attitude/q[2]}, {vehicle_attitude/q[3]})`;
const attitudeSetpoint = (angle: string): string =>
  `${angle}({vehicle_attitude_setpoint/q_d[0]}, {vehicle_attitude_setpoint/q_d[1]}, {vehicle_attitude_setpoint/q_d[2]}, {vehicle_attitude_setpoint/q_d[3]})`;
const indexed = (prefix: string, count: number): readonly string[] => Array.from({ length: count }, (_, i) => `${prefix}[${i}]`);

const indexedFrom = (prefix: string, count: number): readonly string[] => Array.from({ length: count }, (_, i) => `${prefix}${i}`);

export const SETS: readonly PlotSet[] = [
  {
    title: 'Position',
    panes: (['x', 'y', 'z'] as const).map((axis, i) => [
      [`vehicle_local_position/${axis}`, `vehicle_local_position_setpoint/${axis}`, `trajectory_setpoint/position[${i}]`],
      [`LOCAL_POSITION_NED/${axis}`, `POSITION_TARGET_LOCAL_NED/${axis}`],
    ]),
  },
  {
    title: 'Velocity',
    panes: (['vx', 'vy', 'vz'] as const).map((axis, i) => [
      [`vehicle_local_position/${axis}`, `vehicle_local_position_setpoint/${axis}`, `trajectory_setpoint/velocity[${i}]`],
      [`LOCAL_POSITION_NED/${axis}`, `POSITION_TARGET_LOCAL_NED/${axis}`],
    ]),
  },
  {
    title: 'Attitude',
    panes: (['roll', 'pitch', 'yaw'] as const).map((angle) => [[attitude(angle), attitudeSetpoint(angle)], [`degrees({ATTITUDE/${angle}})`]]),
  },
  {
    title: 'Rates',
    panes: (['roll', 'pitch', 'yaw'] as const).map((angle, i) => [
      [`degrees({vehicle_angular_velocity/xyz[${i}]})`, `degrees({vehicle_rates_setpoint/${angle}})`],
      [`degrees({ATTITUDE/${angle}speed})`],
    ]),
  },
  {
    title: 'Actuators',
    panes: [
      [
        indexed('actuator_motors/control', 8),
        indexed('actuator_outputs/output', 8),
        ['servo1_raw', 'servo2_raw', 'servo3_raw', 'servo4_raw'].map((f) => `SERVO_OUTPUT_RAW/${f}`),
      ],
      [[...indexed('vehicle_torque_setpoint/xyz', 3), 'vehicle_thrust_setpoint/xyz[2]']],
    ],
  },
  {
    title: 'Saturation',
    panes: [
      [indexed('actuator_motors/control', 8), ['servo1_raw', 'servo2_raw', 'servo3_raw', 'servo4_raw'].map((f) => `SERVO_OUTPUT_RAW/${f}`)],
      [[...indexed('control_allocator_status/unallocated_torque', 3), 'control_allocator_status/unallocated_thrust[2]']],
      [indexed('control_allocator_status/actuator_saturation', 8)],
    ],
  },
  {
    title: 'Vibration',
    panes: [
      [['vehicle_imu_status/accel_vibration_metric', 'vehicle_imu_status/gyro_vibration_metric'], ['x', 'y', 'z'].map((axis) => `VIBRATION/vibration_${axis}`)],
      [
        ['vehicle_imu_status/accel_clipping[0]', 'vehicle_imu_status/accel_clipping[1]', 'vehicle_imu_status/accel_clipping[2]'],
        indexedFrom('VIBRATION/clipping_', 3),
      ],
      [
        indexed('sensor_combined/accelerometer_m_s2', 3),
        indexed('vehicle_acceleration/xyz', 3),
        ['sensor_accel/x', 'sensor_accel/y', 'sensor_accel/z'],
        ['HIGHRES_IMU/xacc', 'HIGHRES_IMU/yacc', 'HIGHRES_IMU/zacc'],
      ],
      [
        indexed('sensor_combined/gyro_rad', 3),
        indexed('vehicle_angular_velocity/xyz', 3),
        ['sensor_gyro/x', 'sensor_gyro/y', 'sensor_gyro/z'],
        ['ATTITUDE/rollspeed', 'ATTITUDE/pitchspeed', 'ATTITUDE/yawspeed'],
      ],
    ],
    spectra: 2,
  },
  {
    title: 'Battery',
    panes: [
      [['battery_status/voltage_v'], ['BATTERY_STATUS/voltages[0]', 'SYS_STATUS/voltage_battery']],
      [['battery_status/current_a'], ['BATTERY_STATUS/current_battery']],
      [['battery_status/remaining'], ['BATTERY_STATUS/battery_remaining']],
    ],
  },
  {
    title: 'GPS',
    panes: [
      [['vehicle_gps_position/satellites_used'], ['sensor_gps/satellites_used'], ['GPS_RAW_INT/satellites_visible']],
      [
        ['vehicle_gps_position/eph', 'vehicle_gps_position/epv'],
        ['sensor_gps/eph', 'sensor_gps/epv'],
        ['GPS_RAW_INT/h_acc', 'GPS_RAW_INT/v_acc'],
      ],
      [
        ['vehicle_gps_position/jamming_indicator', 'vehicle_gps_position/noise_per_ms'],
        ['sensor_gps/jamming_indicator', 'sensor_gps/noise_per_ms'],
        ['GPS_RAW_INT/fix_type'],
      ],
    ],
  },
  {
    title: 'Estimator',
    panes: [
      [
        ['vel', 'pos', 'hgt', 'mag'].map((name) => `estimator_status/${name}_test_ratio`),
        ['vel_ratio', 'pos_horiz_ratio', 'pos_vert_ratio', 'mag_ratio'].map((f) => `ESTIMATOR_STATUS/${f}`),
      ],
      [
        ['vehicle_local_position/eph', 'vehicle_local_position/epv'],
        ['ESTIMATOR_STATUS/pos_horiz_accuracy', 'ESTIMATOR_STATUS/pos_vert_accuracy'],
      ],
      [['estimator_status/innovation_check_flags', 'estimator_status/solution_status_flags'], ['ESTIMATOR_STATUS/flags']],
    ],
  },
  {
    title: 'Innovations',
    panes: [
      [[...indexed('estimator_innovations/gps_hpos', 2), 'estimator_innovations/gps_vpos']],
      [[...indexed('estimator_innovations/gps_hvel', 2), 'estimator_innovations/gps_vvel']],
      [['estimator_innovations/baro_vpos', 'estimator_innovations/rng_vpos', 'estimator_innovations/ev_vpos']],
      [['estimator_innovations/heading', ...indexed('estimator_innovations/mag_field', 3)]],
    ],
  },
  {
    title: 'Link',
    panes: [
      [['telemetry_status/rx_message_lost_rate', 'telemetry_status/tx_error_rate'], ['SYS_STATUS/drop_rate_comm'], ['LINK_NODE_STATUS/messages_lost']],
      [
        ['telemetry_status/rx_rate_avg', 'telemetry_status/tx_rate_avg'],
        ['LINK_NODE_STATUS/rx_rate', 'LINK_NODE_STATUS/tx_rate'],
      ],
      [
        ['radio_status/rssi', 'radio_status/remote_rssi', 'radio_status/noise'],
        ['RADIO_STATUS/rssi', 'RADIO_STATUS/remrssi', 'RADIO_STATUS/noise'],
      ],
      [['input_rc/rssi'], ['RC_CHANNELS/rssi']],
    ],
  },
];

/** The fields of each pane of a set that a log has; empty: it has none of them. */
export function fieldsOfSet(set: PlotSet, topics: readonly Topic[]): string[][] {
  const known = new Map<string, string>();
  for (const topic of topics)
    for (const { name } of topic.fields) if (!known.has(`${topic.name}/${name}`)) known.set(`${topic.name}/${name}`, `${topic.id}/${name}`);
  return set.panes.flatMap((alternatives) => {
    for (const wanted of alternatives) {
      const found = wanted.map((field) => resolve(field, known)).filter((field) => field !== null);
      if (found.length > 0) return [found];
    }
    return [];
  });
}

/**
 * A saved field as the present sources have it: the same one, or that of the first source whose topic has its name (another
 * instance, another vehicle); null: none has it.
 */
export function placed(saved: string, sources: readonly { readonly prefix: string; readonly topics: readonly Topic[] }[]): string | null {
  const field = saved.replace(/^\d\|/, '');
  for (const isSame of [true, false])
    for (const { prefix, topics } of sources) {
      const known = new Map<string, string>();
      for (const { id, name, fields } of topics)
        for (const each of fields) {
          const key = `${isSame ? id : name}/${each.name}`;
          if (!known.has(key)) known.set(key, `${id}/${each.name}`);
        }
      const found = resolve(isSame ? field : field.replace(/([A-Za-z]\w*):[\d.]+\//g, '$1/'), known);
      if (found !== null) return prefix + found;
    }
  return null;
}

/** A wanted field with the instance that the log has; null: it does not have it. */
function resolve(wanted: string, known: ReadonlyMap<string, string>): string | null {
  if (!wanted.includes('{')) return known.get(wanted) ?? null;
  let isKnown = true;
  const resolved = wanted.replace(/\{([^{}]+)\}/g, (_, name: string) => {
    const field = known.get(name);
    isKnown &&= field !== undefined;
    return `{${field ?? name}}`;
  });
  return isKnown ? resolved : null;
}

export interface FoundField {
  /** As in a request of values. */
  readonly field: string;
  readonly unit: string | null;
}
export interface FoundTopic {
  readonly topic: Topic;
  readonly fields: readonly FoundField[];
}

/** The topics and fields that contain all words of a text; no text: all topics. */
export function findFields(topics: readonly Topic[], text: string): FoundTopic[] {
  const words = text
    .toLowerCase()
    .split(/[\s/]+/)
    .filter(Boolean);
  return topics.flatMap((topic) => {
    const id = topic.id.toLowerCase();
    const fields = topic.fields.filter(({ name }) => words.every((word) => id.includes(word) || name.toLowerCase().includes(word)));
    return fields.length === 0 ? [] : [{ topic, fields: fields.map(({ name, unit }) => ({ field: `${topic.id}/${name}`, unit })) }];
  });
}

/** A field or expression as a short label: without the instance, if it is the first. */
export function labelOf(prefixed: string): string {
  const field = prefixed.replace(/^(second\|)?(\d\|)?/, '');
  if (field.startsWith(RERUN)) return field.slice(RERUN.length);
  if (!field.includes('{')) return field.replace(/:0\//, ' ').replace('/', ' ');
  const call = /^(roll|pitch|yaw)\(\{(\w+):0\/q(?:_d)?\[0\]\}/.exec(field);
  return call === null ? field.replaceAll(':0/', '/') : `${call[1]} of ${call[2]}`;
}
