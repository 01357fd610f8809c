/** Horizontal positions of the obstacles that a vehicle's distance sensors detect. */

import type { DistanceSensors, ObstacleDistance } from '../live/topics';
import { positionAt, type GeoPosition } from './geo';

/** Measurements older than this are not shown [s]. PX4 sends DISTANCE_SENSOR every two seconds by default. */
export const MAX_AGE_S = 2.5;
/** Sensors that look more than 45° up or down are ignored, because they detect no obstacle beside the vehicle (sine of 45°). */
const MAX_SLOPE = 0.7;
const RAD = Math.PI / 180;

/** The sensors' values; null: no such sensor, or no data from it. */
export interface SensorValues {
  sensors: DistanceSensors | null;
  obstacleDistance: ObstacleDistance | null;
}

/** Positions of the obstacles. The vehicle's tilt is ignored. */
export function obstaclePositions(vehicle: GeoPosition, yaw_ned_rad: number | null, measurements: SensorValues): GeoPosition[] {
  const obstacles: GeoPosition[] = [];
  const add = (bearing_rad: number, distance_m: number | null, range_m: number): void => {
    if (distance_m === null || distance_m > range_m) return;
    obstacles.push(positionAt(vehicle, { north_m: distance_m * Math.cos(bearing_rad), east_m: distance_m * Math.sin(bearing_rad) }));
  };
  if (measurements.obstacleDistance !== null && (measurements.obstacleDistance.frame === 'north' || yaw_ned_rad !== null)) {
    const { first_deg, step_deg, distances_m, range_max_m, frame } = measurements.obstacleDistance;
    const reference_rad = frame === 'north' ? 0 : (yaw_ned_rad ?? 0);
    distances_m.forEach((distance_m, index) => add(reference_rad + (first_deg + index * step_deg) * RAD, distance_m, range_max_m));
  }
  if (measurements.sensors !== null && yaw_ned_rad !== null) {
    for (const { direction_frd, distance_m, range_max_m } of measurements.sensors.sensors) {
      const [forward, right, down] = direction_frd;
      if (Math.abs(down) <= MAX_SLOPE) add(yaw_ned_rad + Math.atan2(right, forward), distance_m, range_max_m);
    }
  }
  return obstacles;
}
