/** The vehicles as the map shows them, read from the telemetry once per frame. */

import { identityColour } from '../../vehicle/names';
import { vehicleFacts, type VehicleFacts } from '../../vehicle/facts';
import { ageText } from '../../live/age';
import type { TelemetryStore } from '../../live/store';
import type { VehicleState } from '../../live/vehicle-state';
import { obstaclePositions, MAX_AGE_S } from '../../vehicle/obstacles';
import { heightText } from '../../ui/format';
import type { MapPreview } from '../../app/preview.svelte';
import { groundDistance_m, positionAt, type GeoPosition } from '../../vehicle/geo';

export interface MapVehicle extends GeoPosition {
  id: string;
  selected: boolean;
  lost: boolean;
  /** The position is stale: drawn grey. */
  stale: boolean;
  /** Name of the CSS custom property with the vehicle's own colour. */
  colour: string;
  yaw_rad: number | null;
  label: string;
  /** Oldest point first; shared with the store, must not be changed. */
  trail: readonly GeoPosition[];
  home: GeoPosition | null;
  targets: MapTarget[];
  /** Direction of the camera, clockwise from north [rad]. */
  camera_yaw_rad: number | null;
  /** Obstacles that the vehicle's distance sensors detect now. */
  detectedObstacles: readonly GeoPosition[];
}

/** A target of the vehicle: a position to fly to (`go`), a region of interest (ROI) of the camera, or an unsent setpoint (`preview`). */
export interface MapTarget extends GeoPosition {
  kind: 'go' | 'roi' | 'preview';
  label: string;
  /** Heading of a previewed setpoint. */
  yaw_rad?: number | null;
}

/** A position to which this page has sent a vehicle, or a region of interest of the vehicle's camera. */
export interface RequestedTarget extends GeoPosition {
  alt_home_m: number | null;
}

/** The position to which a vehicle flies, and its region of interest; null: none. */
export interface RequestedTargets {
  go: RequestedTarget | null;
  roi: RequestedTarget | null;
}

/** The position from which the map shows distances, and its name in texts. */
export interface DistanceReference extends GeoPosition {
  name: string;
}
const REFERENCE_NAMES = { home: 'home', vehicle: 'vehicle', firstPoint: 'first point' } as const;

/** The vehicle's home, or else its position; without a vehicle, the first point of the edited layer. */
export function distanceReference(facts: VehicleFacts | null, firstPoint: GeoPosition | null): DistanceReference | null {
  if (facts === null) return firstPoint === null ? null : { ...firstPoint, name: REFERENCE_NAMES.firstPoint };
  if (facts.home !== null) return { ...facts.home.value, name: REFERENCE_NAMES.home };
  return facts.globalPosition === null ? null : { ...facts.globalPosition.value, name: REFERENCE_NAMES.vehicle };
}

/**
 * Latitude and longitude of the streamed position setpoint, from the difference between setpoint and local position; null: none.
 * @param position global position of the vehicle.
 */
function streamedSetpoint(facts: VehicleFacts, position: GeoPosition): MapTarget | null {
  const stream = facts.offboard;
  const local_ned_m = facts.localPosition?.value.position_ned_m;
  if (stream?.streaming !== true || stream.position_ned_m === null || local_ned_m === undefined) return null;
  const [north, east, down] = stream.position_ned_m;
  if (north === null || east === null) return null;
  const setpoint = positionAt(position, { north_m: north - local_ned_m[0], east_m: east - local_ned_m[1] });
  return { ...setpoint, kind: 'go', label: `target${down === null ? '' : ` ${heightText(-down)} above local origin`}` };
}

function previewTarget(id: string, preview: MapPreview | null): MapTarget | null {
  return preview?.vehicle === id ? { ...preview.position, kind: 'preview', label: preview.label, yaw_rad: preview.yaw_ned_rad } : null;
}

function requestedTarget(kind: MapTarget['kind'], name: string, target: RequestedTarget | null): MapTarget | null {
  return target === null
    ? null
    : {
        kind,
        lat_deg: target.lat_deg,
        lon_deg: target.lon_deg,
        label: target.alt_home_m === null ? name : `${name} ${heightText(target.alt_home_m)} above home`,
      };
}

/** Direction of the camera, clockwise from north; null: not known. */
function cameraDirection_rad(facts: VehicleFacts): number | null {
  const gimbal = facts.gimbal;
  const yaw = facts.attitude?.value.yaw_ned_rad ?? null;
  if (gimbal === null || gimbal.stale) return null;
  if (gimbal.value.yaw_ned_rad !== null) return gimbal.value.yaw_ned_rad;
  return gimbal.value.yaw_frd_rad === null || yaw === null ? null : gimbal.value.yaw_frd_rad + yaw;
}

/** Positions of the obstacles that the vehicle's distance sensors detect now. */
function detectedObstacles(vehicle: VehicleState, facts: VehicleFacts, position: GeoPosition): GeoPosition[] {
  const sensors = vehicle.read('distance_sensors', facts.now_unix_s);
  const obstacleDistance = vehicle.read('obstacle_distance', facts.now_unix_s);
  if (sensors === null && obstacleDistance === null) return [];
  return obstaclePositions(position, facts.attitude?.value.yaw_ned_rad ?? null, {
    sensors: sensors !== null && sensors.age_s <= MAX_AGE_S ? sensors.value : null,
    obstacleDistance: obstacleDistance !== null && obstacleDistance.age_s <= MAX_AGE_S ? obstacleDistance.value : null,
  });
}

function vehicleLabel(facts: VehicleFacts): string {
  const position = facts.globalPosition;
  if (position === null) return facts.id;
  const warning = facts.lost ? ' · connection lost' : position.stale ? ` · ${ageText(position.age_s)} old` : '';
  return `${facts.id} · ${heightText(position.value.alt_home_m)} above home${warning}`;
}

/** All vehicles with a position; the selected one last, so that it is drawn on top. */
export function mapVehicles(
  store: TelemetryStore,
  selectedId: string | null,
  targetsOf: (facts: VehicleFacts) => RequestedTargets,
  preview: MapPreview | null = null,
): MapVehicle[] {
  const vehicles: MapVehicle[] = [];
  store.ids().forEach((id, index) => {
    const vehicle = store.vehicles.get(id);
    if (vehicle === undefined) return;
    const facts = vehicleFacts(vehicle, store.nowUnixS(id), store.connected);
    if (facts.globalPosition === null) return;
    const { lat_deg, lon_deg } = facts.globalPosition.value;
    const position = { lat_deg, lon_deg };
    const requestedTargets = targetsOf(facts);
    const setpointTarget = streamedSetpoint(facts, position);
    const targets = [
      setpointTarget ?? requestedTarget('go', 'go-to target', requestedTargets.go),
      requestedTarget('roi', 'ROI', requestedTargets.roi),
      previewTarget(id, preview),
    ];
    vehicles.push({
      ...position,
      id,
      selected: id === selectedId,
      lost: facts.lost,
      stale: !facts.lost && facts.globalPosition.stale && !facts.replayed,
      colour: identityColour(index),
      yaw_rad: facts.attitude?.value.yaw_ned_rad ?? null,
      label: vehicleLabel(facts),
      trail: vehicle.trail.points,
      home: facts.home?.value ?? null,
      camera_yaw_rad: cameraDirection_rad(facts),
      detectedObstacles: facts.lost ? [] : detectedObstacles(vehicle, facts, position),
      targets: targets.filter((t): t is MapTarget => t !== null),
    });
  });
  return vehicles.sort((a, b) => Number(a.selected) - Number(b.selected));
}

/** If a vehicle is closer to its target than this, the vehicle has reached the target [m]. */
const REACHED_M = 2;
/** A vehicle must start to fly to a target within this time [s]. */
const START_TIMEOUT_S = 5;

/**
 * Whether the vehicle is still flying to a target: it is armed, is in Hold mode and has not reached the target. In the first
 * seconds after the request the result is true.
 */
export function isTargetActive(target: RequestedTarget & { since_s: number }, facts: VehicleFacts, now_s: number): boolean {
  const mode = facts.status?.value.mode ?? '';
  if (now_s - target.since_s < START_TIMEOUT_S) return true;
  if (facts.status?.value.armed !== true || mode !== 'hold' || facts.globalPosition === null) return false;
  const altitudeDifference_m = target.alt_home_m === null ? 0 : Math.abs(facts.globalPosition.value.alt_home_m - target.alt_home_m);
  return groundDistance_m(target, facts.globalPosition.value) > REACHED_M || altitudeDifference_m > REACHED_M;
}
