/** What the plan room is made of, in one piece that is loaded when it is opened. */

import { registry, rooms, type RoomParts } from '../../app/registry.svelte';
import { editor } from './controllers';
import PlanCard from './PlanCard.svelte';
import PlanRoom from './PlanRoom.svelte';

export const parts: RoomParts = { station: PlanRoom, cards: [{ component: PlanCard }] };

registry.addCloser({ order: 75, isOpen: () => rooms.current === 'plan' && editor.placing !== null, close: () => editor.stopPlacing() });
