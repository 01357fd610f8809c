/** How far a gimbal can turn, as it reports it. */

import type { Gimbal } from '../live/topics';
import { toDeg } from '../ui/format';

export interface Limits {
  pitchMin_deg: number;
  pitchMax_deg: number;
  yawMin_deg: number;
  yawMax_deg: number;
  /** False: the gimbal told none, the pad shows its own range. */
  told: boolean;
}

export interface Angles {
  pitch_deg: number;
  yaw_deg: number;
}

export function limits(gimbal: Gimbal | null): Limits {
  const pitchMin = toDeg(gimbal?.pitch_min_rad ?? null);
  const pitchMax = toDeg(gimbal?.pitch_max_rad ?? null);
  const yawMin = toDeg(gimbal?.yaw_min_rad ?? null);
  const yawMax = toDeg(gimbal?.yaw_max_rad ?? null);
  const told = pitchMin !== null && pitchMax !== null && pitchMax > pitchMin;
  return {
    pitchMin_deg: told ? Math.max(-180, pitchMin) : -90,
    pitchMax_deg: told ? Math.min(180, pitchMax) : 30,
    yawMin_deg: yawMin !== null && yawMax !== null && yawMax > yawMin ? Math.max(-180, yawMin) : -180,
    yawMax_deg: yawMin !== null && yawMax !== null && yawMax > yawMin ? Math.min(180, yawMax) : 180,
    told,
  };
}
