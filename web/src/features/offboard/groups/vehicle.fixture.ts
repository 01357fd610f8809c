/** Vehicle facts for the tests of groups. */

import type { VehicleFacts } from '../../../vehicle/facts';

export const reading = <T>(value: T, stale = false): { value: T; age_s: number; stale: boolean } => ({ value, age_s: 0, stale });

export function vehicle(id: string, position_ned_m: number[] | null, lat_deg = 47): VehicleFacts {
  return {
    id,
    name: `Quad ${id}`,
    lost: false,
    offline: false,
    inAir: true,
    localPosition: position_ned_m === null ? null : reading({ position_ned_m }),
    attitude: reading({ yaw_ned_rad: 1 }),
    globalPosition: reading({ lat_deg, lon_deg: 8, alt_amsl_m: 500, alt_home_m: 10 }),
  } as unknown as VehicleFacts;
}
