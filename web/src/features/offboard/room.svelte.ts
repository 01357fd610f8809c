/** Opens the offboard room. Small: the room's own code is loaded when it is opened. */

import { rooms } from '../../app/registry.svelte';

export const ROOM = 'offboard';

class OffboardRoomState {
  /** Whether the room opens at its part for groups. */
  atGroups = $state(false);

  open(): void {
    rooms.open(ROOM);
  }

  close(): void {
    if (rooms.current === ROOM) rooms.open('fly');
  }

  showGroups(): void {
    this.atGroups = true;
    this.open();
  }
}

export const room = new OffboardRoomState();
