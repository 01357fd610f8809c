/** Values that come from more than one message; the more accurate source has priority. */

import type { VehicleFacts } from '../../vehicle/facts';
import type { FlightClock } from '../../live/flight-time';
import { duration, UNKNOWN } from '../../ui/format';

export interface Climb {
  m_s: number | null;
  stale: boolean;
  age_s: number | null;
}

/** Climb rate (up is positive), from the HUD message or from the global position. */
export function climbOf(facts: Pick<VehicleFacts, 'hud' | 'global'>): Climb {
  const source = facts.hud ?? facts.global;
  const m_s = facts.hud?.value.climb_m_s ?? (facts.global === null ? null : -facts.global.value.velocity_ned_m_s[2]);
  return { m_s, stale: source?.stale ?? false, age_s: source?.age_s ?? null };
}

/**
 * Time since take-off, with "> " if the page connected during the flight. On the ground: the duration of the last
 * flight.
 */
export function flightOf(facts: Pick<VehicleFacts, 'lost' | 'now_unix_s'>, clock: FlightClock | undefined): { label: string; text: string } {
  if (clock === undefined) return { label: 'Flight time', text: UNKNOWN };
  if (clock.airborneSince_unix_s !== null) {
    const until = facts.lost ? clock.updated_unix_s : facts.now_unix_s;
    return { label: 'Flight time', text: `${clock.exact ? '' : '> '}${duration(until - clock.airborneSince_unix_s)}` };
  }
  return { label: clock.lastFlight_s === null ? 'Flight time' : 'Last flight', text: duration(clock.lastFlight_s) };
}
