/** Flight time of a vehicle, from its landed state. After a reload it is restored from the history. */

import type { Status } from './topics';

export interface FlightClock {
  /** Time of take-off; null on the ground or before the first sample. */
  airborneSince_unix_s: number | null;
  /** False if the page connected during the flight: the time shown is then a lower bound. */
  exact: boolean;
  /** Whether the vehicle has been seen on the ground. */
  seenGround: boolean;
  /** Duration of the last flight that ended, for the value grid after landing [s]. */
  last_s: number | null;
  updated_unix_s: number;
}

export const NO_FLIGHT: FlightClock = {
  airborneSince_unix_s: null,
  exact: true,
  seenGround: false,
  last_s: null,
  updated_unix_s: 0,
};

function flying(status: Status): boolean | null {
  switch (status.landed_state) {
    case 'in_air':
    case 'landing':
      return true;
    case 'taking_off':
      return null; // the motors turn on the ground: this neither starts nor ends a flight
    case 'on_ground':
      return false;
    default:
      return status.armed ? null : false;
  }
}

/** The state after one more status sample; samples older than the newest one are ignored. */
export function advance(clock: FlightClock, status: Status, unix_s: number): FlightClock {
  if (unix_s <= clock.updated_unix_s) return clock;
  const now = flying(status);
  const next = { ...clock, updated_unix_s: unix_s };
  if (now === null) return next;
  if (now && clock.airborneSince_unix_s === null) {
    return { ...next, airborneSince_unix_s: unix_s, exact: clock.seenGround };
  }
  if (!now) {
    const since = clock.airborneSince_unix_s;
    return { ...next, airborneSince_unix_s: null, exact: true, seenGround: true, last_s: since === null ? clock.last_s : unix_s - since };
  }
  return next;
}
