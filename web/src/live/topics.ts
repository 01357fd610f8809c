/** What a vehicle says of itself, as the telemetry carries it: the server's own description of it. Unknown is null. */

import type { components } from '../api/schema';

export type Vector3 = [number, number, number];
export type MaybeVector3 = [number | null, number | null, number | null];

type Schemas = components['schemas'];

export type Attitude = Schemas['AttitudeSample']['value'];
export type LocalPosition = Schemas['LocalPositionSample']['value'];
export type GlobalPosition = Schemas['GlobalPositionSample']['value'];
export type Gps = Schemas['GpsSample']['value'];
export type Battery = Schemas['BatterySample']['value'];
export type Home = Schemas['HomeSample']['value'];
export type Component = Schemas['Component'];
export type Gimbal = Schemas['GimbalSample']['value'];
export type Hud = Schemas['HudSample']['value'];
export type Health = Schemas['HealthSample']['value'];
export type DistanceSensors = Schemas['DistanceSensorsSample']['value'];
export type ObstacleDistance = Schemas['ObstacleDistanceSample']['value'];
export type Status = Schemas['StatusSample']['value'];

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
  hud: Hud;
  health: Health;
  distance_sensors: DistanceSensors;
  obstacle_distance: ObstacleDistance;
}

export type TopicName = keyof Topics;

/** What this page always reads of a vehicle; topics of chosen values (`target_local`, `motors`, …) come beside them. */
export const PAGE_TOPICS: readonly string[] = [
  'status',
  'attitude',
  'local_position',
  'global_position',
  'gps',
  'battery',
  'home',
  'gimbal',
  'hud',
  'health',
  'mission',
  'offboard_mission',
  'distance_sensors',
  'obstacle_distance',
  'readiness',
  'offboard',
  'control',
  'identity',
  'components',
];

/** Of a large fleet, for the list and the map: what each vehicle is, does, and where it is. */
export const FLEET_TOPICS: readonly string[] = ['status', 'attitude', 'global_position', 'battery', 'home', 'health', 'identity'];

/** Periods PX4 sends at [s], used until a topic's own period has been measured. */
export const NOMINAL_PERIOD_S: Readonly<Record<string, number>> = {
  status: 1,
  attitude: 0.05,
  local_position: 0.1,
  global_position: 0.2,
  gps: 1,
  battery: 2,
  home: 2,
  gimbal: 0.2,
  target_local: 0.2,
  hud: 0.2,
  health: 1,
  mission: 1,
  distance_sensors: 0.2,
  obstacle_distance: 0.2,
};
