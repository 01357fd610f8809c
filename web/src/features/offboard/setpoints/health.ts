/** The stream's health from the topic `offboard`. Ages are counted until now, not until the time of the sample. */

import type { components } from '../../../api/schema';

type WireHealth = components['schemas']['OffboardStatus']['health'];

export interface StreamHealth {
  setpoint_age_s: number | null;
  /** Time until PX4's failsafe acts if no further setpoint arrives. */
  failsafe_in_s: number | null;
  /** Age of the target that the vehicle reported back. */
  echo_age_s: number | null;
  position_error_m: number | null;
  velocity_error_m_s: number | null;
  attitude_error_rad: number | null;
  yaw_error_rad: number | null;
}

/** @param age_s age of the sample. */
export function readHealth(topicValue: unknown, age_s: number): StreamHealth {
  const health = (topicValue as { health?: Partial<WireHealth> | null } | null)?.health ?? null;
  const finiteNumber = (value: unknown): number | null => (typeof value === 'number' && Number.isFinite(value) ? value : null);
  const withSampleAge = (value: unknown): number | null => (finiteNumber(value) === null ? null : (value as number) + age_s);
  return {
    setpoint_age_s: withSampleAge(health?.setpoint_age_s),
    // Not reduced by the sample's age: the server continues to send setpoints, and each setpoint restarts this time.
    failsafe_in_s: finiteNumber(health?.failsafe_in_s),
    echo_age_s: withSampleAge(health?.echo?.age_s),
    position_error_m: finiteNumber(health?.position_error_m),
    velocity_error_m_s: finiteNumber(health?.velocity_error_m_s),
    attitude_error_rad: finiteNumber(health?.attitude_error_rad),
    yaw_error_rad: finiteNumber(health?.yaw_error_rad),
  };
}
