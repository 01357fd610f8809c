/**
 * What a vehicle says of itself, as the telemetry carries it: the names are those of
 * `gcs_server/vehicle/samples.py`. Unknown is null.
 */

export type Vector3 = [number, number, number];
export type MaybeVector3 = [number | null, number | null, number | null];
export type Quaternion = [number, number, number, number];

export interface Attitude {
  roll_rad: number;
  pitch_rad: number;
  yaw_ned_rad: number;
  q_ned_frd: Quaternion;
  rates_frd_rad_s: Vector3;
}

export interface LocalPosition {
  position_ned_m: Vector3;
  velocity_ned_m_s: Vector3;
}

export interface GlobalPosition {
  lat_deg: number;
  lon_deg: number;
  alt_amsl_m: number;
  alt_home_m: number;
  velocity_ned_m_s: Vector3;
  heading_deg: number | null;
}

export interface Gps {
  fix_type: number;
  satellites: number | null;
  hdop: number | null;
  horizontal_accuracy_m: number | null;
}

export interface Battery {
  remaining_percent: number | null;
  voltage_v: number | null;
  current_a: number | null;
  consumed_mah: number | null;
  time_remaining_s: number | null;
}

export interface Home {
  lat_deg: number;
  lon_deg: number;
  alt_amsl_m: number;
  position_ned_m: Vector3 | null;
}

export interface Gimbal {
  gimbal_device_id: number;
  roll_rad: number;
  pitch_rad: number;
  yaw_frd_rad: number | null;
  yaw_ned_rad: number | null;
  yaw_lock: boolean;
  primary_control: [number, number] | null;
  secondary_control: [number, number] | null;
  flags: number;
  pitch_min_rad: number | null;
  pitch_max_rad: number | null;
  yaw_min_rad: number | null;
  yaw_max_rad: number | null;
}

export interface TargetLocal {
  position_ned_m: MaybeVector3;
  velocity_ned_m_s: MaybeVector3;
  yaw_ned_rad: number | null;
  yaw_rate_ned_rad_s: number | null;
}

export interface Hud {
  groundspeed_m_s: number;
  airspeed_m_s: number;
  climb_m_s: number;
  throttle_percent: number;
}

export interface Health {
  sensors_present: number;
  sensors_enabled: number;
  sensors_healthy: number;
  ready_to_arm: boolean | null;
  cpu_load: number | null;
}

export interface Status {
  armed: boolean;
  mode: string;
  mode_label: string;
  custom_mode: number;
  intended_custom_mode: number | null;
  landed_state: 'unknown' | 'on_ground' | 'in_air' | 'taking_off' | 'landing';
  system_status: number;
  link_lost: boolean;
  last_heartbeat_age_s: number;
}

/** Topic name → its value. */
export interface Topics {
  status: Status;
  attitude: Attitude;
  local_position: LocalPosition;
  global_position: GlobalPosition;
  gps: Gps;
  battery: Battery;
  home: Home;
  gimbal: Gimbal;
  target_local: TargetLocal;
  hud: Hud;
  health: Health;
}

export type TopicName = keyof Topics;

/** What this page subscribes to; `offboard` and `identity` are read by their own modules. */
export const PAGE_TOPICS: readonly string[] = [
  'status', 'attitude', 'local_position', 'global_position', 'gps', 'battery', 'home', 'gimbal',
  'target_local', 'hud', 'health', 'offboard', 'identity',
];

/** Periods PX4 sends at [s], used until a topic's own period has been measured. */
export const NOMINAL_PERIOD_S: Readonly<Record<string, number>> = {
  status: 1, attitude: 0.05, local_position: 0.1, global_position: 0.2, gps: 1, battery: 2, home: 2,
  gimbal: 0.2, target_local: 0.2, hud: 0.2, health: 1, offboard: 0.5,
};
