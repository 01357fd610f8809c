/** Which ended missions' cards a person has closed. Kept in this browser tab, also when the page is reloaded. */

import { memory } from '../../app/identity';

const PREFIX = 'gcs.closed-mission.';

export class ClosedCards {
  private readonly closed = $state<Record<string, string | null>>({});

  constructor(private readonly storage: Pick<Storage, 'getItem' | 'setItem'>) {}

  /** @param started_unix_s start of the vehicle's mission, which identifies the mission. */
  isClosed(vehicle: string, started_unix_s: number): boolean {
    return (this.closed[vehicle] ?? this.storage.getItem(PREFIX + vehicle)) === String(started_unix_s);
  }

  close(vehicle: string, started_unix_s: number): void {
    this.closed[vehicle] = String(started_unix_s);
    this.storage.setItem(PREFIX + vehicle, String(started_unix_s));
  }
}

export const closedCards = new ClosedCards(memory(() => sessionStorage));
