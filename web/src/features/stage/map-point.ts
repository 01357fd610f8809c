/**
 * A point on the map or in the 3D view: why actions are not possible there, camera angles, distances and times. Pure functions.
 */

import { BOUNDS } from '../../api/bounds';
import type { VehicleFacts } from '../../vehicle/facts';
import { distanceText, fixed, heightText, toDeg, wrap180 } from '../../ui/format';
import { angleLimits, type Angles } from '../../vehicle/gimbal';
import { bearing_rad, groundDistance_m, type Pixel, type GeoPosition } from '../../vehicle/geo';

export interface MapPoint extends GeoPosition {
  /** Terrain altitude at the point; null if the view does not know it. */
  ground_amsl_m: number | null;
  /** Pixel on the stage for a point in the 3D view; null for a point on the map. */
  scenePixel: Pixel | null;
}

/** The API's limits for altitudes [m above home]. */
export const ALTITUDE_RANGE_M = BOUNDS.GotoRequest.alt_home_m;
/** Largest distance from the vehicle to a go-to target [m] that the API accepts by default. */
const MAX_GO_DISTANCE_M = 1000;

const IS_REPLAY = 'A replayed vehicle accepts no commands.';
const NO_CONNECTION = 'No connection to the vehicle.';
const NO_POSITION = 'The vehicle’s position is not known.';
const NO_HOME = 'The home position is not known.';

/** Smallest height above the known ground at which the menu offers to fly [m]. */
const MIN_GO_HEIGHT_M = 5;

/** The vehicle's speeds in automatic modes, from its parameters; null: not known. */
export interface Speeds {
  horizontal_m_s: number | null;
  up_m_s: number | null;
  down_m_s: number | null;
}

export const NO_SPEEDS: Speeds = { horizontal_m_s: null, up_m_s: null, down_m_s: null };

/** Altitude of home AMSL [m]: reported, or else the difference of the vehicle's altitudes AMSL and above home. */
export function homeAmsl_m(facts: VehicleFacts): number | null {
  if (facts.home !== null) return facts.home.value.alt_amsl_m;
  return facts.globalPosition === null ? null : facts.globalPosition.value.alt_amsl_m - facts.globalPosition.value.alt_home_m;
}

export function distance_m(facts: VehicleFacts, mapPoint: GeoPosition): number | null {
  return facts.globalPosition === null ? null : groundDistance_m(facts.globalPosition.value, mapPoint);
}

/** Altitude of the ground at the point above home [m]; null: not known. */
function ground_home_m(facts: VehicleFacts, { ground_amsl_m }: MapPoint): number | null {
  const home = homeAmsl_m(facts);
  return ground_amsl_m === null || home === null ? null : ground_amsl_m - home;
}

/**
 * Altitude above home that the menu offers to fly to [m]: the vehicle's altitude, or on the ground the take-off altitude, but
 * never below the ground at the point.
 */
export function suggestedGoAlt_home_m(facts: VehicleFacts, mapPoint: MapPoint, takeoffAlt_home_m: number, usualAlt_home_m: number | null = null): number {
  const alt_home_m =
    usualAlt_home_m !== null ? usualAlt_home_m : facts.inAir ? (facts.globalPosition?.value.alt_home_m ?? takeoffAlt_home_m) : takeoffAlt_home_m;
  const ground_m = ground_home_m(facts, mapPoint);
  return Math.round(10 * (ground_m === null ? alt_home_m : Math.max(alt_home_m, ground_m + MIN_GO_HEIGHT_M))) / 10;
}

/** Flight time [s]: the longer time of horizontal flight and climb or descent; null if a required speed is not known. */
export function flightTime_s(facts: VehicleFacts, mapPoint: GeoPosition, alt_home_m: number, speeds: Speeds): number | null {
  const toPoint_m = distance_m(facts, mapPoint);
  if (toPoint_m === null || facts.globalPosition === null || speeds.horizontal_m_s === null || speeds.horizontal_m_s <= 0) return null;
  const climb_m = alt_home_m - facts.globalPosition.value.alt_home_m;
  const verticalSpeed_m_s = climb_m > 0 ? speeds.up_m_s : speeds.down_m_s;
  if (Math.abs(climb_m) > 0.5 && (verticalSpeed_m_s === null || verticalSpeed_m_s <= 0)) return null;
  return Math.max(toPoint_m / speeds.horizontal_m_s, verticalSpeed_m_s === null ? 0 : Math.abs(climb_m) / verticalSpeed_m_s);
}

/** Why "Go here" is not possible now at this altitude; null: it is possible. */
export function whyNotGo(facts: VehicleFacts, mapPoint: MapPoint, alt_home_m: number): string | null {
  if (facts.replayed) return IS_REPLAY;
  if (facts.lost) return NO_CONNECTION;
  const toPoint_m = distance_m(facts, mapPoint);
  if (toPoint_m === null || facts.globalPosition?.stale === true) return NO_POSITION;
  if (facts.home === null) return NO_HOME;
  if (!facts.inAir) return 'The vehicle is on the ground: take off first.';
  const ground_m = ground_home_m(facts, mapPoint);
  if (ground_m !== null && alt_home_m < ground_m) return `The ground at this position is ${heightText(ground_m)} above home: choose a greater altitude.`;
  return toPoint_m > MAX_GO_DISTANCE_M ? `${distanceText(toPoint_m)} away; the limit is ${distanceText(MAX_GO_DISTANCE_M)}. Fly there in shorter legs.` : null;
}

/**
 * Camera angles at which the point is seen from the vehicle's position; `yaw_deg` from the nose, `yaw_ned_deg` from
 * north. Null: position or heading is not known.
 */
export function lookAngles(facts: VehicleFacts, mapPoint: GeoPosition, point_home_m: number): (Angles & { yaw_ned_deg: number }) | null {
  const yaw_deg = toDeg(facts.attitude?.value.yaw_ned_rad);
  if (facts.globalPosition === null || yaw_deg === null) return null;
  const toPoint_m = groundDistance_m(facts.globalPosition.value, mapPoint);
  const down_m = facts.globalPosition.value.alt_home_m - point_home_m;
  const yaw_ned_deg = wrap180((bearing_rad(facts.globalPosition.value, mapPoint) * 180) / Math.PI);
  return { pitch_deg: (-Math.atan2(down_m, toPoint_m) * 180) / Math.PI, yaw_deg: wrap180(yaw_ned_deg - yaw_deg), yaw_ned_deg };
}

function whyNoCamera(facts: VehicleFacts): string | null {
  if (facts.replayed) return IS_REPLAY;
  if (facts.lost) return NO_CONNECTION;
  if (facts.gimbal === null) return 'The vehicle reports no gimbal.';
  return facts.globalPosition === null || facts.globalPosition.stale ? NO_POSITION : null;
}

/** Why "Look here" is not possible now; null: it is possible. */
export function whyNotLook(facts: VehicleFacts, mapPoint: GeoPosition, point_home_m: number, hasGimbalControl: boolean): string | null {
  const why = whyNoCamera(facts);
  if (why !== null) return why;
  if (!hasGimbalControl) return 'Take control of the gimbal first, on the gimbal card.';
  const angles = lookAngles(facts, mapPoint, point_home_m);
  if (angles === null) return 'The vehicle’s heading is not known.';
  const limits = angleLimits(facts.gimbal?.value ?? null);
  const isOutside = (value: number, min: number, max: number): boolean => value < min - 0.05 || value > max + 0.05;
  if (limits.isReported && isOutside(angles.pitch_deg, limits.pitchMin_deg, limits.pitchMax_deg))
    return `Outside the gimbal’s range: pitch ${fixed(angles.pitch_deg, 0)}°.`;
  if (isOutside(angles.yaw_deg, limits.yawMin_deg, limits.yawMax_deg)) return `Outside the gimbal’s range: ${fixed(angles.yaw_deg, 0, true)}° from the nose.`;
  return null;
}

/**
 * Why "Set ROI" is not possible now; null: it is possible. An ROI needs the altitude of home AMSL, but not gimbal
 * control.
 */
export function whyNotRoi(facts: VehicleFacts): string | null {
  return whyNoCamera(facts) ?? (homeAmsl_m(facts) === null ? NO_HOME : null);
}

/** The altitude within the permitted range; null if it is not a number. */
export function altitudeInRange(value_m: number): number | null {
  return Number.isFinite(value_m) ? Math.min(ALTITUDE_RANGE_M.max, Math.max(ALTITUDE_RANGE_M.min, value_m)) : null;
}

const COMPASS_WORDS = ['north of', 'north-east of', 'east of', 'south-east of', 'south of', 'south-west of', 'west of', 'north-west of'];

/** Distance and direction to a position: "34 m north-east of". */
export function directionText(from: GeoPosition, to: GeoPosition): string {
  const direction = COMPASS_WORDS[Math.round(bearing_rad(from, to) / (Math.PI / 4) + 8) % 8];
  return `${distanceText(groundDistance_m(from, to))} ${direction}`;
}

export interface Size {
  width: number;
  height: number;
}

/** Position of the menu's upper left corner: beside the point, within the free area. */
export function menuCorner(at: Pixel, menu: Size, freeArea: { left: number; top: number; right: number; bottom: number }): Pixel {
  const gap_px = 20;
  const right = at.x + gap_px;
  const x = right + menu.width <= freeArea.right ? right : at.x - gap_px - menu.width;
  const y = at.y - menu.height / 3;
  return { x: Math.max(freeArea.left, Math.min(x, freeArea.right - menu.width)), y: Math.max(freeArea.top, Math.min(y, freeArea.bottom - menu.height)) };
}
