/** The cards of ended flights that a person has closed. The browser tab stores these cards, so that a reload does not open them again. */

import { availableStorage } from '../../../app/identity';

const KEY_PREFIX = 'gcs.closed-flight.';
/** The card of an offboard mission or of a waypoint plan. */
type Card = 'offboard' | 'waypoints';

export class ClosedCards {
  /** Start of the closed flight, by card and vehicle. */
  private readonly closedFlights = $state<Record<string, string | null>>({});

  constructor(private readonly storage: Pick<Storage, 'getItem' | 'setItem'>) {}

  /** @param started_unix_s start of the flight, which identifies the flight. */
  isClosed(card: Card, vehicle: string, started_unix_s: number): boolean {
    const key = `${card}.${vehicle}`;
    return (this.closedFlights[key] ?? this.storage.getItem(KEY_PREFIX + key)) === String(started_unix_s);
  }

  close(card: Card, vehicle: string, started_unix_s: number): void {
    const key = `${card}.${vehicle}`;
    this.closedFlights[key] = String(started_unix_s);
    this.storage.setItem(KEY_PREFIX + key, String(started_unix_s));
  }
}

export const closedCards = new ClosedCards(availableStorage(() => sessionStorage));
