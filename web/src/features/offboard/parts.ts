/** The parts of the offboard room, loaded when the room is first opened. */

import type { RoomParts } from '../../app/registry.svelte';
import HealthCard from './setpoints/HealthCard.svelte';
import OffboardRoom from './setpoints/OffboardRoom.svelte';
import SentCard from './setpoints/SentCard.svelte';

export const parts: RoomParts = { room: OffboardRoom, cards: [{ vehicleComponent: HealthCard }, { component: SentCard }] };
