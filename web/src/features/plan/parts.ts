/** The parts of the plan room, loaded together when it is first opened. */

import { registry, rooms, type RoomParts } from '../../app/registry.svelte';
import { editor } from './controllers';
import PlanCard from './PlanCard.svelte';
import PlanRoom from './PlanRoom.svelte';

export const parts: RoomParts = { station: PlanRoom, cards: [{ component: PlanCard }] };

registry.addCloser({ order: 75, isOpen: () => rooms.current === 'plan' && editor.placing !== null, close: () => editor.stopPlacing() });
