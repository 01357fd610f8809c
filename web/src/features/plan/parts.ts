/** The parts of the plan room. They are loaded when the room is first opened. */

import { registry, rooms, type RoomParts } from '../../app/registry.svelte';
import { division, drawing, editor, insertion } from './controllers';
import PlanCard from './editor/PlanCard.svelte';
import PlanRoom from './PlanRoom.svelte';

export const parts: RoomParts = { roomWithoutVehicle: PlanRoom, cards: [{ component: PlanCard }] };

registry.addCloser({ order: 76, isOpen: () => rooms.openId === 'plan' && division.row !== null, close: () => division.close() });
registry.addCloser({ order: 76, isOpen: () => rooms.openId === 'plan' && insertion.isOpen, close: () => insertion.close() });
registry.addCloser({ order: 75, isOpen: () => rooms.openId === 'plan' && editor.partToPlace !== null, close: () => editor.stopPlacing() });
registry.addCloser({ order: 76, isOpen: () => rooms.openId === 'plan' && division.row !== null, close: () => division.close() });
registry.addCloser({ order: 76, isOpen: () => rooms.openId === 'plan' && drawing.kind !== null, close: () => drawing.cancel() });
