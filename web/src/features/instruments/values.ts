/** Values computed on the page: vertical speed and flight time. */

import type { VehicleFacts } from '../../vehicle/facts';
import type { FlightClock } from '../../live/flight-time';
import { duration, UNKNOWN } from '../../ui/format';

export interface VerticalSpeed {
  speed_m_s: number | null;
  stale: boolean;
  age_s: number | null;
}

/** Vertical speed (up is positive) from the HUD message; if there is none, from the global position. */
export function verticalSpeed(facts: Pick<VehicleFacts, 'hud' | 'globalPosition'>): VerticalSpeed {
  const source = facts.hud ?? facts.globalPosition;
  const speed_m_s = facts.hud?.value.climb_m_s ?? (facts.globalPosition === null ? null : -facts.globalPosition.value.velocity_ned_m_s[2]);
  return { speed_m_s, stale: source?.stale ?? false, age_s: source?.age_s ?? null };
}

/**
 * Time since take-off, with "> " if the page connected during the flight. On the ground: the duration of the last
 * flight.
 */
export function flightTimeText(facts: Pick<VehicleFacts, 'lost' | 'now_unix_s'>, clock: FlightClock | undefined): string {
  if (clock === undefined) return UNKNOWN;
  if (clock.airborneSince_unix_s !== null) {
    const until_unix_s = facts.lost ? clock.updated_unix_s : facts.now_unix_s;
    return `${clock.exact ? '' : '> '}${duration(until_unix_s - clock.airborneSince_unix_s)}`;
  }
  return duration(clock.lastFlight_s);
}
