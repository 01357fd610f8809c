/** The parts of the vehicle room, loaded when the room is first opened. */

import type { RoomParts } from '../../app/registry.svelte';
import VehicleRoom from './VehicleRoom.svelte';

export const parts: RoomParts = { room: VehicleRoom, cards: [] };
