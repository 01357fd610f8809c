/**
 * A dry run on the map and as text: the flown path, the corridor of many flights, vehicle and gimbal at one time.
 * Pure functions.
 */

import { corridorRings } from '../../../app/corridor';
import type { LayerContent } from '../../../app/map-layers.svelte';
import { distance, durationText, fixed, lengthText } from '../../../ui/format';
import { positionAt, type GeoPosition } from '../../../vehicle/geo';
import type { DryRunResult } from './dry-run.svelte';

type Vector = readonly number[];
type SimulatedFlight = DryRunResult['nominal'];
type MonteCarlo = NonNullable<DryRunResult['monte_carlo']>;

export interface SimulatedVehicle extends GeoPosition {
  /** Altitude above the start. */
  readonly up_m: number;
  readonly speed_m_s: number;
  readonly step: string;
  /** Headings of vehicle and camera, clockwise from north. */
  readonly yaw_deg: number;
  readonly camera_yaw_deg: number;
  /** Pitch of the camera, positive up. */
  readonly camera_pitch_deg: number;
}

const DEG_PER_RAD = 180 / Math.PI;
/** Half the field of view of the drawn camera footprint [deg]. */
const HALF_FIELD_OF_VIEW_DEG = 27;
/** Shortest and longest drawn camera footprint [m]. */
const FOOTPRINT_LENGTH_M = { min: 4, max: 15 } as const;
/** The simulated flight of each vehicle under the given conditions, without variation. */
const nominalFlights = (result: DryRunResult): readonly SimulatedFlight[] => (result.group == null ? [result.nominal] : Object.values(result.group.roles));

/** The Monte Carlo flights of each vehicle with its role; the role is null for a plan with one vehicle. */
function monteCarloByRole({ monte_carlo, group }: DryRunResult): (readonly [string | null, MonteCarlo])[] {
  if (monte_carlo === null) return [];
  return group?.monte_carlo == null ? [[null, monte_carlo]] : Object.entries(group.monte_carlo.roles);
}

/** The simulated vehicle at a time, with its position interpolated between the samples; null: the vehicle did not take off. */
export function simulatedVehicleAt({ nominal }: Pick<DryRunResult, 'nominal'>, t_s: number): SimulatedVehicle | null {
  const { path, origin } = nominal;
  const lastIndex = (path?.t_s.length ?? 0) - 1;
  if (path === null || lastIndex < 0) return null;
  let [low, high] = [0, lastIndex];
  while (low < high) {
    const middle = Math.ceil((low + high) / 2);
    if ((path.t_s[middle] ?? 0) <= t_s) low = middle;
    else high = middle - 1;
  }
  const next = Math.min(low + 1, lastIndex);
  const [from_s, to_s] = [path.t_s[low] ?? 0, path.t_s[next] ?? 0];
  const fraction = to_s > from_s ? Math.min(1, Math.max(0, (t_s - from_s) / (to_s - from_s))) : 0;
  const [a, b] = [(path.position_ned_m[low] ?? []) as Vector, (path.position_ned_m[next] ?? []) as Vector];
  const interpolate = (axis: number): number => (a[axis] ?? 0) + fraction * ((b[axis] ?? 0) - (a[axis] ?? 0));
  return {
    ...positionAt(origin, { north_m: interpolate(0), east_m: interpolate(1) }),
    up_m: -interpolate(2) + 0,
    speed_m_s: Math.hypot(...((path.velocity_ned_m_s[low] ?? []) as Vector)),
    step: path.step_places[path.step[low] ?? -1] ?? '',
    yaw_deg: yaw_deg((path.q_ned_frd[low] ?? [1, 0, 0, 0]) as Vector),
    camera_yaw_deg: (path.gimbal_rad[low]?.[1] ?? 0) * DEG_PER_RAD,
    camera_pitch_deg: (path.gimbal_rad[low]?.[0] ?? 0) * DEG_PER_RAD,
  };
}

function yaw_deg([w = 1, x = 0, y = 0, z = 0]: Vector): number {
  return Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) * DEG_PER_RAD;
}

/** The camera's footprint on the ground, cut off at the longest drawn length; empty if the footprint is too short to be drawn. */
function cameraFootprint(vehicle: SimulatedVehicle): GeoPosition[] {
  const slope = Math.tan(-vehicle.camera_pitch_deg / DEG_PER_RAD);
  const farEdgeDistance_m = slope > 1e-3 ? Math.max(0, vehicle.up_m) / slope : FOOTPRINT_LENGTH_M.max;
  if (farEdgeDistance_m < FOOTPRINT_LENGTH_M.min) return [];
  const length_m = Math.min(FOOTPRINT_LENGTH_M.max, farEdgeDistance_m);
  const farPoint = (turn_deg: number): GeoPosition => {
    const angle = (vehicle.camera_yaw_deg + turn_deg) / DEG_PER_RAD;
    return positionAt(vehicle, { north_m: length_m * Math.cos(angle), east_m: length_m * Math.sin(angle) });
  };
  return [{ lat_deg: vehicle.lat_deg, lon_deg: vehicle.lon_deg }, farPoint(-HALF_FIELD_OF_VIEW_DEG), farPoint(0), farPoint(HALF_FIELD_OF_VIEW_DEG)];
}

/** Paths and corridors, in the colour of planned paths. They do not depend on the time. */
export function dryRunLayer(result: DryRunResult): LayerContent {
  const paths = nominalFlights(result).map(({ path, origin }) =>
    ((path?.position_ned_m ?? []) as readonly Vector[]).map(([north_m = 0, east_m = 0]) => positionAt(origin, { north_m, east_m })),
  );
  return {
    lines: paths.filter((positions) => positions.length > 1).map((positions) => ({ positions, tone: 'target', style: 'dotted' })),
    areas: monteCarloByRole(result)
      .flatMap(([, { corridor }]) => (corridor === null ? [] : corridorRings(result.nominal.origin, corridor.position_ned_m, corridor.horizontal_m.p95)))
      .map((ring) => ({ ring, tone: 'target' })),
    points: [],
  };
}

/** The simulated vehicles at a time, with the footprints of their cameras. */
export function simulatedVehicleLayer(result: DryRunResult, t_s: number): LayerContent | null {
  const vehicles = nominalFlights(result).flatMap((nominal) => simulatedVehicleAt({ nominal }, t_s) ?? []);
  if (vehicles.length === 0) return null;
  return {
    lines: [],
    areas: vehicles
      .map(cameraFootprint)
      .filter((ring) => ring.length > 2)
      .map((ring) => ({ ring, tone: 'target' })),
    points: vehicles.map(({ lat_deg, lon_deg, yaw_deg: yaw }, i) => ({
      id: i === 0 ? 'simulated vehicle' : `simulated vehicle ${i}`,
      lat_deg,
      lon_deg,
      mark: 'vehicle',
      tone: 'target',
      text: '',
      selected: false,
      yaw_deg: yaw,
    })),
  };
}

/** The position of a finding on the map; null: the finding has neither a position nor a time in the flight. */
export function findingPosition(
  result: DryRunResult,
  { position_ned_m, t_s }: Pick<SimulatedFlight['findings'][number], 'position_ned_m' | 't_s'>,
): GeoPosition | null {
  if (position_ned_m !== null) return positionAt(result.nominal.origin, { north_m: position_ned_m[0], east_m: position_ned_m[1] });
  const vehicle = t_s === null ? null : simulatedVehicleAt(result, t_s);
  return vehicle === null ? null : { lat_deg: vehicle.lat_deg, lon_deg: vehicle.lon_deg };
}

const percentText = (fraction: number | null): string => (fraction === null ? 'not known' : `${fixed(100 * fraction, 0)} %`);

/** The result as sentences. */
export function resultLines(result: DryRunResult): string[] {
  const { nominal, group } = result;
  const length = distance(nominal.length_m);
  const isBatteryKnown = nominal.battery_start_share !== null || nominal.battery_end_share !== null;
  const batteryText = isBatteryKnown ? `battery ${percentText(nominal.battery_start_share)} → ${percentText(nominal.battery_end_share)}` : 'battery not known';
  const releases = [...new Set(nominalFlights(result).map(({ px4 }) => `PX4 v${px4}`))].join(' and ');
  const lines = [
    `${nominal.finished ? 'Dry run' : 'Dry run not completed'}: ${durationText(nominal.duration_s)}, ${length.text} ${length.unit}, ${batteryText}; simulated ${releases}.`,
  ];
  if (nominal.fence_distance_m !== null) lines.push(`Distance to the geofence: at least ${lengthText(nominal.fence_distance_m)}.`);
  for (const { roles, distance_m, t_s } of group?.closest ?? [])
    lines.push(`${roles.join(' and ')} stay at least ${lengthText(distance_m)} apart; they are closest after ${durationText(t_s)}.`);
  for (const [role, monteCarlo] of monteCarloByRole(result)) lines.push(monteCarloText(role, monteCarlo));
  for (const { roles, distance_m, nearer_than_minimum: tooNear } of group?.monte_carlo?.closest ?? [])
    lines.push(
      `Smallest separation of ${roles.join(' and ')} in all flights: ${lengthText(distance_m.least)}. In ${tooNear.count} ${tooNear.count === 1 ? 'flight' : 'flights'} they came closer than the minimum separation (estimated probability: at most ${percentText(tooNear.upper)}).`,
    );
  return lines;
}

function monteCarloText(role: string | null, monteCarlo: MonteCarlo): string {
  const parts = [`95 % within ${fixed(Math.max(0, ...(monteCarlo.corridor?.horizontal_m.p95 ?? [])), 1)} m of the path`];
  if (monteCarlo.duration_s !== null)
    parts.push(`flight time ${durationText(monteCarlo.duration_s.p5)} to ${durationText(monteCarlo.duration_s.p95)} (5th to 95th percentile)`);
  if (monteCarlo.battery_end_share !== null) parts.push(`95 % with at least ${percentText(monteCarlo.battery_end_share.p5)} battery at the end`);
  return `${role === null ? '' : `${role}, `}${monteCarlo.flights.length} simulated flights: ${parts.join('; ')}.`;
}
