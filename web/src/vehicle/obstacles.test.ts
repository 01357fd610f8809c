import { describe, expect, it } from 'vitest';
import { eastNorth } from './geo';
import { obstaclePositions, type SensorValues } from './obstacles';

const POSITION = { lat_deg: 47.4, lon_deg: 8.5 };
const NO_SENSORS: SensorValues = { sensors: null, obstacleDistance: null };
const scan = (frame: string, distances_m: (number | null)[]): SensorValues['obstacleDistance'] => ({
  frame,
  first_deg: 0,
  step_deg: 90,
  distances_m,
  range_min_m: 0.1,
  range_max_m: 20,
});
const sensor = (direction_frd: [number, number, number], distance_m: number | null): NonNullable<SensorValues['sensors']>['sensors'][number] => ({
  sensor_id: 0,
  direction_frd,
  distance_m,
  range_min_m: 0.1,
  range_max_m: 20,
  width_rad: null,
  behind_s: 0,
});
const eastNorth_m = (measured: SensorValues, yaw_rad: number | null): number[][] =>
  obstaclePositions(POSITION, yaw_rad, measured).map((obstacle) => {
    const { east_m, north_m } = eastNorth(POSITION, obstacle);
    return [Math.round(east_m * 10) / 10 || 0, Math.round(north_m * 10) / 10 || 0];
  });

describe('detected obstacles', () => {
  it('are positioned relative to the heading or to north, without unknown and out-of-range distances', () => {
    expect(eastNorth_m({ ...NO_SENSORS, obstacleDistance: scan('body', [5, 6, 20.01, null]) }, Math.PI / 2)).toEqual([
      [5, 0],
      [0, -6],
    ]);
    expect(eastNorth_m({ ...NO_SENSORS, obstacleDistance: scan('north', [5]) }, null)).toEqual([[0, 5]]);
    expect(eastNorth_m({ ...NO_SENSORS, obstacleDistance: scan('body', [5]) }, null)).toEqual([]);
  });
  it('come from sensors that look sideways, not from sensors that look down', () => {
    const sensors = { sensors: [sensor([1, 0, 0], 4), sensor([0, 0, 1], 2), sensor([0, 1, 0], null)] };
    expect(eastNorth_m({ ...NO_SENSORS, sensors }, 0)).toEqual([[0, 4]]);
    expect(eastNorth_m(NO_SENSORS, 0)).toEqual([]);
  });
});
