/** The parts of the room of the settings, loaded when the room is first opened. */

import type { RoomParts } from '../../app/registry.svelte';
import SettingsRoom from './SettingsRoom.svelte';

export const parts: RoomParts = { roomWithoutVehicle: SettingsRoom, cards: [] };
