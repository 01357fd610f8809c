/** The stream's health from the topic `offboard`, advanced to the present time between two samples. */

import type { components } from '../../../api/schema';

type Wire = components['schemas']['OffboardStatus']['health'];

export interface HealthNow {
  setpoint_age_s: number | null;
  failsafe_in_s: number | null;
  echo_age_s: number | null;
  position_error_m: number | null;
  velocity_error_m_s: number | null;
  attitude_error_rad: number | null;
  yaw_error_rad: number | null;
}

/** @param age_s age of the sample. */
export function readHealth(topic: unknown, age_s: number): HealthNow {
  const health = (topic as { health?: Partial<Wire> | null } | null)?.health ?? null;
  const number = (value: unknown): number | null => (typeof value === 'number' && Number.isFinite(value) ? value : null);
  const older = (value: unknown): number | null => (number(value) === null ? null : (value as number) + age_s);
  return {
    setpoint_age_s: older(health?.setpoint_age_s),
    // The stream continues while the sample ages, so the remaining times stay unchanged until the sample is stale.
    failsafe_in_s: number(health?.failsafe_in_s),
    echo_age_s: older(health?.echo?.age_s),
    position_error_m: number(health?.position_error_m),
    velocity_error_m_s: number(health?.velocity_error_m_s),
    attitude_error_rad: number(health?.attitude_error_rad),
    yaw_error_rad: number(health?.yaw_error_rad),
  };
}
