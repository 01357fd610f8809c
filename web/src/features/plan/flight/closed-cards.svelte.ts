/** Which ended flights' cards a person has closed. Kept in this browser tab, also when the page is reloaded. */

import { availableStorage } from '../../../app/identity';

const PREFIX = 'gcs.closed-flight.';
/** An offboard mission, or a waypoint plan. */
type Card = 'offboard' | 'waypoints';

export class ClosedCards {
  private readonly closed = $state<Record<string, string | null>>({});

  constructor(private readonly storage: Pick<Storage, 'getItem' | 'setItem'>) {}

  /** @param started_unix_s start of the vehicle's flight, which identifies the flight. */
  isClosed(card: Card, vehicle: string, started_unix_s: number): boolean {
    const key = `${card}.${vehicle}`;
    return (this.closed[key] ?? this.storage.getItem(PREFIX + key)) === String(started_unix_s);
  }

  close(card: Card, vehicle: string, started_unix_s: number): void {
    const key = `${card}.${vehicle}`;
    this.closed[key] = String(started_unix_s);
    this.storage.setItem(PREFIX + key, String(started_unix_s));
  }
}

export const closedCards = new ClosedCards(availableStorage(() => sessionStorage));
