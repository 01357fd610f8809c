/** Flight time of a vehicle, from its landed state. After a reload the page computes it again from the history. */

import type { Status } from './topics';

export interface FlightClock {
  /** Time of take-off; null on the ground or before the first sample. */
  airborneSince_unix_s: number | null;
  /** False if the page connected during the flight: the flight time is then a lower bound. */
  exact: boolean;
  /** Whether a sample has reported the vehicle on the ground. */
  wasOnGround: boolean;
  /** Duration of the last flight that ended [s]. */
  lastFlight_s: number | null;
  updated_unix_s: number;
}

export const NO_FLIGHT: FlightClock = {
  airborneSince_unix_s: null,
  exact: true,
  wasOnGround: false,
  lastFlight_s: null,
  updated_unix_s: 0,
};

/**
 * Whether a landed state means that the vehicle is not landed. PX4 reports `taking_off` after its land detector has left
 * the state "landed", until the vehicle reaches the take-off altitude.
 */
export function isAirborne(landedState: string): boolean {
  return landedState === 'taking_off' || landedState === 'in_air' || landedState === 'landing';
}

/** Whether the vehicle is flying; null: the status does not show it. */
function isFlying(status: Status): boolean | null {
  if (isAirborne(status.landed_state)) return true;
  return status.landed_state === 'on_ground' || !status.armed ? false : null;
}

/** The clock after one more status sample; samples older than the newest sample are ignored. */
export function updatedClock(clock: FlightClock, status: Status, unix_s: number): FlightClock {
  if (unix_s <= clock.updated_unix_s) return clock;
  const inFlight = isFlying(status);
  const next = { ...clock, updated_unix_s: unix_s };
  if (inFlight === null) return next;
  if (inFlight && clock.airborneSince_unix_s === null) {
    return { ...next, airborneSince_unix_s: unix_s, exact: clock.wasOnGround };
  }
  if (!inFlight) {
    const airborneSince_unix_s = clock.airborneSince_unix_s;
    return {
      ...next,
      airborneSince_unix_s: null,
      exact: true,
      wasOnGround: true,
      lastFlight_s: airborneSince_unix_s === null ? clock.lastFlight_s : unix_s - airborneSince_unix_s,
    };
  }
  return next;
}
