/** The parts of the room of flights, loaded when it is first opened. */

import { registry, rooms, type RoomParts } from '../../app/registry.svelte';
import { closeShown, ROOM, library, live, view } from './controllers';
import FlightRoom from './FlightRoom.svelte';

export const parts: RoomParts = { roomWithoutVehicle: FlightRoom, cards: [] };

registry.addCloser({ order: 77, isOpen: () => rooms.openId === ROOM && library.toDelete !== null, close: () => (library.toDelete = null) });
registry.addCloser({ order: 78, isOpen: () => rooms.openId === ROOM && (view.id !== null || live.vehicle !== null), close: closeShown });
