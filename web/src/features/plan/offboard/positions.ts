/** Converts positions between the map and a mission; each position keeps its frame. Pure functions. */

import { heightText } from '../../../ui/format';
import { eastNorth, positionAt, type GeoPosition } from '../../../vehicle/geo';
import type { PlannedHome } from '../document/document';
import type { Mission, MissionPosition, Vector } from './mission';

/** Positions of a mission's start and of the local origin on the earth. */
export interface MissionFrame {
  /** Start of the mission: the vehicle's home, or else the mission's planned home. */
  readonly start: PlannedHome;
  /** Origin of the vehicle's local frame. */
  readonly origin: PlannedHome;
  /** False: the start is not known, and the mission is drawn at an arbitrary position. */
  readonly isStartKnown: boolean;
}

const UNKNOWN_START: PlannedHome = { lat_deg: 0, lon_deg: 0, alt_amsl_m: 0 };

/** @param origin the local origin that the server's check used. */
export function missionFrameOf(mission: Mission | null, vehicleHome: PlannedHome | null, origin: PlannedHome | null): MissionFrame {
  const start = vehicleHome ?? mission?.home ?? null;
  return { start: start ?? UNKNOWN_START, origin: origin ?? start ?? UNKNOWN_START, isStartKnown: start !== null };
}

export type PositionFrame = 'offset' | 'home' | 'amsl' | 'local';

export function positionFrameOf(position: MissionPosition): PositionFrame {
  if (position.offset_ned_m != null) return 'offset';
  if (position.position_ned_m != null) return 'local';
  return position.alt_amsl_m != null ? 'amsl' : 'home';
}

/** A position on the earth with its altitude above the start [m]. */
export interface GeoPoint extends GeoPosition {
  readonly up_m: number;
}

export function geoPointOf(position: MissionPosition, frame: MissionFrame): GeoPoint {
  const local = position.offset_ned_m ?? position.position_ned_m;
  if (local != null) {
    const reference = position.offset_ned_m != null ? frame.start : frame.origin;
    return { ...positionAt(reference, { north_m: local[0], east_m: local[1] }), up_m: reference.alt_amsl_m - local[2] - frame.start.alt_amsl_m };
  }
  const up_m = position.alt_amsl_m != null ? position.alt_amsl_m - frame.start.alt_amsl_m : (position.alt_home_m ?? 0);
  return { lat_deg: position.lat_deg ?? 0, lon_deg: position.lon_deg ?? 0, up_m };
}

const roundCm = (value_m: number): number => Number(value_m.toFixed(2));
const WITHOUT_POSITION = {
  position_ned_m: undefined,
  offset_ned_m: undefined,
  lat_deg: undefined,
  lon_deg: undefined,
  alt_amsl_m: undefined,
  alt_home_m: undefined,
};

/** A position in the given frame. @param point a point whose other fields are kept. */
export function positionInFrame(positionFrame: PositionFrame, geoPoint: GeoPoint, frame: MissionFrame, point: MissionPosition = {}): MissionPosition {
  const otherFields: MissionPosition = Object.fromEntries(Object.entries({ ...point, ...WITHOUT_POSITION }).filter(([, value]) => value !== undefined));
  const amsl_m = frame.start.alt_amsl_m + geoPoint.up_m;
  if (positionFrame === 'home' || positionFrame === 'amsl') {
    const latLon = { lat_deg: Number(geoPoint.lat_deg.toFixed(8)), lon_deg: Number(geoPoint.lon_deg.toFixed(8)) };
    return positionFrame === 'amsl'
      ? { ...otherFields, ...latLon, alt_amsl_m: roundCm(amsl_m) }
      : { ...otherFields, ...latLon, alt_home_m: roundCm(geoPoint.up_m) };
  }
  const reference = positionFrame === 'offset' ? frame.start : frame.origin;
  const { north_m, east_m } = eastNorth(reference, geoPoint);
  const vector: Vector = [roundCm(north_m), roundCm(east_m), roundCm(reference.alt_amsl_m - amsl_m)];
  return positionFrame === 'offset' ? { ...otherFields, offset_ned_m: vector } : { ...otherFields, position_ned_m: vector };
}

/** Changes the altitude of a point by `by_m`; the frame is kept. */
export function raisedBy(position: MissionPosition, by_m: number): MissionPosition {
  const positionFrame = positionFrameOf(position);
  if (positionFrame === 'home') return { ...position, alt_home_m: roundCm((position.alt_home_m ?? 0) + by_m) };
  if (positionFrame === 'amsl') return { ...position, alt_amsl_m: roundCm((position.alt_amsl_m ?? 0) + by_m) };
  const field = positionFrame === 'offset' ? 'offset_ned_m' : 'position_ned_m';
  const [north_m, east_m, down_m] = position[field] as Vector;
  return { ...position, [field]: [north_m, east_m, roundCm(down_m - by_m)] };
}

/** The altitude of a point as text: AMSL, above home or above the start, depending on its frame. */
export function altitudeText(position: MissionPosition, frame: MissionFrame): string {
  if (position.alt_amsl_m != null) return `${heightText(position.alt_amsl_m)} AMSL`;
  return `${heightText(geoPointOf(position, frame).up_m)} above ${positionFrameOf(position) === 'home' ? 'home' : 'the start'}`;
}

/** Moves a point horizontally; altitude and frame are kept. */
export function movedTo(position: MissionPosition, target: GeoPosition, frame: MissionFrame): MissionPosition {
  const positionFrame = positionFrameOf(position);
  const { up_m } = geoPointOf(position, frame);
  const moved = positionInFrame(positionFrame, { ...target, up_m }, frame, position);
  // Keeps the exact altitude, without rounding.
  if (positionFrame === 'home') return { ...moved, alt_home_m: position.alt_home_m ?? 0 };
  if (positionFrame === 'amsl') return { ...moved, alt_amsl_m: position.alt_amsl_m ?? 0 };
  const field = positionFrame === 'offset' ? 'offset_ned_m' : 'position_ned_m';
  const [oldVector, newVector] = [position[field] as Vector, moved[field] as Vector];
  return { ...moved, [field]: [newVector[0], newVector[1], oldVector[2]] };
}
