/** Names of vehicles and vehicle types. */

import type { Identity } from '../live/vehicle-state';

/** Names by MAV_TYPE. */
const TYPES: Readonly<Record<number, string>> = {
  1: 'Fixed wing',
  2: 'Quad',
  3: 'Coaxial',
  4: 'Helicopter',
  10: 'Rover',
  11: 'Boat',
  12: 'Submarine',
  13: 'Hexa',
  14: 'Octo',
  15: 'Tri',
  19: 'VTOL',
  20: 'VTOL',
  21: 'VTOL',
  22: 'VTOL',
};

/** MAV_AUTOPILOT of ArduPilot. */
const ARDUPILOT = 3;

/** Name of a vehicle: type and id, for example "Quad 1". */
export function vehicleName(id: string, identity: Identity): string {
  const type = identity.vehicle_type === null ? undefined : TYPES[identity.vehicle_type];
  const typeText = identity.autopilot === ARDUPILOT ? `ArduPilot ${type ?? ''}`.trim() : type;
  return typeText === undefined ? `Vehicle ${id}` : `${typeText} ${id}`;
}

/** Four identity colours of vehicles; from the fifth vehicle on they repeat. */
const IDENTITY_COLOURS = ['--actual', '--id-2', '--id-3', '--id-4'] as const;

export function identityColour(index: number): string {
  return IDENTITY_COLOURS[((index % 4) + 4) % 4] ?? '--actual';
}
