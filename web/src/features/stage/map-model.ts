/** What the map shows, in metres east and north of one reference, taken from the telemetry once per frame. */

import { identityColour } from '../../app/names';
import { vehicleFacts, type VehicleFacts } from '../../app/facts';
import type { TelemetryStore } from '../../live/store';
import { fixed } from '../../ui/format';
import { eastNorth, type EastNorth, type Place } from './geo';

export interface MapVehicle {
  id: string;
  selected: boolean;
  lost: boolean;
  colour: string;
  at: EastNorth;
  yaw_rad: number | null;
  label: string;
  trail: EastNorth[];
  home: EastNorth | null;
  target: { at: EastNorth; label: string } | null;
  /** Where the camera looks from north [rad]. */
  look_rad: number | null;
}

/** The place everything is drawn from: the selected vehicle's home, else where it is. */
export function referencePlace(facts: VehicleFacts): Place | null {
  return facts.home?.value ?? facts.global?.value ?? null;
}

/** A place in the vehicle's own local frame; through where it is in both frames now. */
function fromLocal(facts: VehicleFacts, at: EastNorth, north_m: number, east_m: number): EastNorth | null {
  const here = facts.local?.value.position_ned_m;
  return here === undefined ? null : { north_m: at.north_m + north_m - here[0], east_m: at.east_m + east_m - here[1] };
}

function target(facts: VehicleFacts, at: EastNorth): MapVehicle['target'] {
  const stream = facts.offboard;
  if (stream?.streaming !== true || stream.position_ned_m === null) return null;
  const [north, east, down] = stream.position_ned_m;
  const place = north === null || east === null ? null : fromLocal(facts, at, north, east);
  return place === null ? null : { at: place, label: `target${down === null ? '' : ` ${fixed(-down, 1)} m up`}` };
}

function look(facts: VehicleFacts): number | null {
  const gimbal = facts.gimbal;
  const yaw = facts.attitude?.value.yaw_ned_rad ?? null;
  if (gimbal === null || gimbal.stale) return null;
  if (gimbal.value.yaw_ned_rad !== null) return gimbal.value.yaw_ned_rad;
  return gimbal.value.yaw_frd_rad === null || yaw === null ? null : gimbal.value.yaw_frd_rad + yaw;
}

/** All vehicles with a position; the selected one last, so that it is drawn on top. */
export function mapVehicles(store: TelemetryStore, reference: Place, selectedId: string | null): MapVehicle[] {
  const now = store.nowUnixS();
  const found: MapVehicle[] = [];
  store.ids().forEach((id, index) => {
    const vehicle = store.vehicles.get(id);
    if (vehicle === undefined) return;
    const facts = vehicleFacts(vehicle, now);
    if (facts.global === null) return;
    const at = eastNorth(reference, facts.global.value);
    found.push({
      id, at, selected: id === selectedId, lost: facts.lost, colour: identityColour(index),
      yaw_rad: facts.attitude?.value.yaw_ned_rad ?? null,
      label: `${id} · ${fixed(facts.global.value.alt_home_m, 1)} m${facts.lost ? ' · lost' : ''}`,
      trail: vehicle.trail.points.map((p) => eastNorth(reference, p)),
      home: facts.home === null ? null : eastNorth(reference, facts.home.value),
      target: target(facts, at),
      look_rad: look(facts),
    });
  });
  return found.sort((a, b) => Number(a.selected) - Number(b.selected));
}
