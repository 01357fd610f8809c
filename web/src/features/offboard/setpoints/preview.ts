/** Preview of an unsent setpoint: position, yaw and description. Pure functions. */

import type { VehicleFacts } from '../../../vehicle/facts';
import type { Vector3 } from '../../../live/topics';
import { distance, heightText, wrap180 } from '../../../ui/format';
import { eastNorth, positionAt, type GeoPosition } from '../../../vehicle/geo';
import type { SetpointJson } from './form';

/** The preview of a velocity is the position that the vehicle reaches after this time [s]. */
const EXTRAPOLATION_S = 3;

export interface SetpointPreview {
  position_ned_m: Vector3;
  yaw_ned_rad: number | null;
  /** True: the vehicle reaches this position after `EXTRAPOLATION_S` at the velocity setpoint. False: the setpoint contains the position. */
  isExtrapolated: boolean;
}

type MaybeTriple = readonly (number | null)[] | undefined;

function triple(value: unknown): MaybeTriple {
  return Array.isArray(value) && value.length === 3 ? (value as (number | null)[]) : undefined;
}

function yawOf(setpoint: SetpointJson, heading_rad: number | null): number | null {
  if (typeof setpoint['yaw_ned_rad'] === 'number') return setpoint['yaw_ned_rad'];
  if (typeof setpoint['yaw_offset_rad'] === 'number') return heading_rad === null ? null : heading_rad + setpoint['yaw_offset_rad'];
  return heading_rad;
}

/** Rotates a vector from FRD (along the heading) to NED. */
export function bodyToNed([forward, right, down]: Vector3, yaw_rad: number): Vector3 {
  const [cos, sin] = [Math.cos(yaw_rad), Math.sin(yaw_rad)];
  return [forward * cos - right * sin, forward * sin + right * cos, down];
}

/** The preview of a setpoint; null for types without a position and velocity, such as attitude and rates, and if the vehicle's position is not known. */
export function previewOf(setpoint: SetpointJson, facts: VehicleFacts): SetpointPreview | null {
  const vehicle_ned_m = facts.localPosition?.value.position_ned_m;
  const yaw = facts.attitude?.value.yaw_ned_rad ?? null;
  if (vehicle_ned_m === undefined) return null;
  const yaw_ned_rad = yawOf(setpoint, yaw);
  const previewAt = (vector: MaybeTriple, factor: number, isExtrapolated: boolean): SetpointPreview => ({
    position_ned_m: vehicle_ned_m.map((v, i) => v + (vector?.[i] ?? 0) * factor) as Vector3,
    yaw_ned_rad,
    isExtrapolated,
  });
  const position = triple(setpoint['position_ned_m']);
  if (position !== undefined) return { position_ned_m: vehicle_ned_m.map((v, i) => position[i] ?? v) as Vector3, yaw_ned_rad, isExtrapolated: false };
  if (setpoint.type === 'position_global') return globalPreview(setpoint, facts, vehicle_ned_m, yaw_ned_rad);
  const offset = setpoint.type === 'follow' ? undefined : triple(setpoint['offset_frd_m']);
  if (offset !== undefined) return yaw === null ? null : previewAt(bodyToNed(offset.map((v) => v ?? 0) as Vector3, yaw), 1, false);
  const velocity = triple(setpoint['velocity_ned_m_s']);
  if (velocity !== undefined) return previewAt(velocity, EXTRAPOLATION_S, true);
  const bodyVelocity = triple(setpoint['velocity_frd_m_s']);
  if (bodyVelocity !== undefined) return yaw === null ? null : previewAt(bodyToNed(bodyVelocity.map((v) => v ?? 0) as Vector3, yaw), EXTRAPOLATION_S, true);
  return null;
}

function globalPreview(setpoint: SetpointJson, facts: VehicleFacts, vehicle_ned_m: Readonly<Vector3>, yaw_ned_rad: number | null): SetpointPreview | null {
  const vehicle = facts.globalPosition?.value;
  if (vehicle === undefined) return null;
  const { east_m, north_m } = eastNorth(vehicle, { lat_deg: setpoint['lat_deg'] as number, lon_deg: setpoint['lon_deg'] as number });
  const [altHome_m, altAmsl_m] = [setpoint['alt_home_m'], setpoint['alt_amsl_m']];
  const up_m = typeof altHome_m === 'number' ? altHome_m - vehicle.alt_home_m : typeof altAmsl_m === 'number' ? altAmsl_m - vehicle.alt_amsl_m : 0;
  return { position_ned_m: [vehicle_ned_m[0] + north_m, vehicle_ned_m[1] + east_m, vehicle_ned_m[2] - up_m], yaw_ned_rad, isExtrapolated: false };
}

/** The preview's latitude and longitude, computed from the vehicle's global position and the offset to the preview. */
export function previewOnMap(preview: SetpointPreview, facts: VehicleFacts): GeoPosition | null {
  const vehicle_ned_m = facts.localPosition?.value.position_ned_m;
  const vehicle = facts.globalPosition?.value;
  if (vehicle_ned_m === undefined || vehicle === undefined) return null;
  return positionAt(vehicle, { north_m: preview.position_ned_m[0] - vehicle_ned_m[0], east_m: preview.position_ned_m[1] - vehicle_ned_m[1] });
}

/** Description relative to the vehicle, for example "12.4 m away, 3.0 m above the vehicle, turns 40° right". */
export function previewText(preview: SetpointPreview, facts: VehicleFacts): string {
  const vehicle_ned_m = facts.localPosition?.value.position_ned_m;
  if (vehicle_ned_m === undefined) return 'The vehicle’s position is not known.';
  const [n, e, d] = preview.position_ned_m.map((v, i) => v - (vehicle_ned_m[i] ?? 0)) as Vector3;
  const distance_m = Math.hypot(n, e);
  const { text, unit } = distance(distance_m);
  const parts = [
    distance_m < 0.05 ? 'at the current position' : `${text} ${unit} away${preview.isExtrapolated ? ` after ${EXTRAPOLATION_S} s at this velocity` : ''}`,
  ];
  if (Math.abs(d) >= 0.05) parts.push(`${heightText(Math.abs(d))} ${d < 0 ? 'above' : 'below'} the vehicle`);
  const yaw = facts.attitude?.value.yaw_ned_rad ?? null;
  if (preview.yaw_ned_rad !== null && yaw !== null) {
    const turn = Math.round(wrap180(((preview.yaw_ned_rad - yaw) * 180) / Math.PI));
    if (turn !== 0) parts.push(`turns ${Math.abs(turn)}° ${turn > 0 ? 'right' : 'left'}`);
  }
  return parts.join(', ');
}
