/** What the offboard room is made of, in one piece that is loaded when it is opened. */

import type { RoomParts } from '../../app/registry.svelte';
import HealthCard from './setpoints/HealthCard.svelte';
import OffboardRoom from './setpoints/OffboardRoom.svelte';
import SentCard from './setpoints/SentCard.svelte';

export const parts: RoomParts = { room: OffboardRoom, cards: [{ ofVehicle: HealthCard }, { component: SentCard }] };
