/** The gimbals of a vehicle and their reported limits. */

import type { Gimbal } from '../live/topics';
import type { VehicleFacts } from './facts';
import { toDeg } from '../ui/format';

export interface AngleLimits {
  pitchMin_deg: number;
  pitchMax_deg: number;
  yawMin_deg: number;
  yawMax_deg: number;
  /** False: the gimbal reported no pitch limits, so the pitch limits are default values. */
  isReported: boolean;
}

export interface Angles {
  pitch_deg: number;
  yaw_deg: number;
}

/** The reported limits; default values where the gimbal reported none. */
export function angleLimits(gimbal: Gimbal | null): AngleLimits {
  const pitchMin = toDeg(gimbal?.pitch_min_rad ?? null);
  const pitchMax = toDeg(gimbal?.pitch_max_rad ?? null);
  const yawMin = toDeg(gimbal?.yaw_min_rad ?? null);
  const yawMax = toDeg(gimbal?.yaw_max_rad ?? null);
  const isReported = pitchMin !== null && pitchMax !== null && pitchMax > pitchMin;
  return {
    pitchMin_deg: isReported ? Math.max(-180, pitchMin) : -90,
    pitchMax_deg: isReported ? Math.min(180, pitchMax) : 30,
    yawMin_deg: yawMin !== null && yawMax !== null && yawMax > yawMin ? Math.max(-180, yawMin) : -180,
    yawMax_deg: yawMin !== null && yawMax !== null && yawMax > yawMin ? Math.min(180, yawMax) : 180,
    isReported,
  };
}

/** Key of the gimbal in these facts: vehicle, component id of the gimbal manager, gimbal device id. */
export function gimbalKey(facts: VehicleFacts): string {
  const gimbal = facts.gimbal?.value;
  return gimbal === undefined ? `${facts.id}/` : `${facts.id}/${gimbal.component_id}.${gimbal.gimbal_device_id}`;
}

/** The facts with the gimbal that has this key; unchanged if none has this key. */
export function withGimbal(facts: VehicleFacts, key: string): VehicleFacts {
  return gimbalsOf(facts).find((candidate) => gimbalKey(candidate) === key) ?? facts;
}

/** A copy of the facts for each gimbal; empty if the vehicle has only one gimbal. */
export function gimbalsOf(facts: VehicleFacts): VehicleFacts[] {
  const reading = facts.gimbal;
  if (reading === null) return [];
  const { gimbals } = reading.value;
  return gimbals.map((gimbal) => ({ ...facts, gimbal: { ...reading, value: { ...gimbal, gimbals } } }));
}

/** Path and query parameters of a call to a gimbal; a vehicle with one gimbal needs no gimbal id. */
export function gimbalParams(facts: VehicleFacts): { params: { path: { v: string }; query?: { component: number; device?: number } } } {
  const path = { v: facts.id };
  const gimbal = facts.gimbal?.value;
  if (gimbal === undefined || gimbal.gimbals.length === 0) return { params: { path } };
  const device = gimbal.gimbal_device_id;
  return { params: { path, query: { component: gimbal.component_id, ...(device === 0 ? {} : { device }) } } };
}
