/** A vehicle's telemetry topics, with types from the server's OpenAPI description. Null: not known. */

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
export type Orbit = Schemas['OrbitSample']['value'];
export type Status = Schemas['StatusSample']['value'];
export type Mission = Schemas['Mission'];

/** Types of the topics' values by name. */
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
  orbit: Orbit;
  obstacle_distance: ObstacleDistance;
}

export type TopicName = keyof Topics;

/**
 * Topics to which this page always subscribes; the topics of the values on the grid (`target_local`, `motors`, …) are added.
 */
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
  'waypoint_flight',
  'distance_sensors',
  'obstacle_distance',
  'orbit',
  'readiness',
  'offboard',
  'control',
  'manual_control',
  'identity',
  'components',
  'reach',
  'landed_log',
];

/** Topics of every vehicle in a large fleet, for list and map. */
export const FLEET_TOPICS: readonly string[] = ['status', 'attitude', 'global_position', 'battery', 'home', 'health', 'identity', 'landed_log'];

/** Assumed periods [s], used until the page has measured the period of a vehicle's topic. */
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
  orbit: 0.5,
};
