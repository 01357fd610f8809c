/** Opens the offboard room. This module is separate from the room's code, which is loaded when the room is opened. */

import { rooms } from '../../app/registry.svelte';

export const ROOM_ID = 'offboard';

class OffboardRoomState {
  /** Set to open the room at the group panel; the room resets it. */
  groupsRequested = $state(false);

  open(): void {
    rooms.open(ROOM_ID);
  }

  close(): void {
    if (rooms.openId === ROOM_ID) rooms.open('fly');
  }

  showGroups(): void {
    this.groupsRequested = true;
    this.open();
  }
}

export const room = new OffboardRoomState();
