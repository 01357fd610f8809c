/** The plan on a vehicle, and its differences from the edited plan, as text. Pure functions. */

import type { components } from '../../../api/schema';
import type { Status } from '../../../live/topics';
import { fixed, heightText } from '../../../ui/format';
import type { WaypointFlight } from './mission-start';

type Schemas = components['schemas'];
/** The server's knowledge of the plan on a vehicle. */
export type VehiclePlan = Readonly<Schemas['MissionView']['holds']>;
export type Comparison = Readonly<Schemas['MissionComparison']>;
export type Difference = Comparison['differences'][number];

const PART_NAMES = { mission: 'mission', fence: 'geofence', rally: 'rally points' } as const;
const FIELD_NAMES: Readonly<Record<string, string>> = {
  command: 'command (MAV_CMD)',
  frame: 'altitude reference',
  z: 'altitude',
  autocontinue: 'autocontinue',
};

/** Altitude reference for each MAV_FRAME value that plans use. */
const ALTITUDE_REFERENCES: Readonly<Record<number, string>> = {
  0: 'AMSL',
  2: 'no position',
  3: 'above home',
  5: 'AMSL',
  6: 'above home',
  10: 'above terrain',
  11: 'above terrain',
};

/** Sentence about the plan on the vehicle. @param editedVersion version of the edited plan; null: the plan has unsaved changes. */
export function vehiclePlanText(
  name: string,
  vehiclePlan: VehiclePlan | undefined,
  editedVersion: { readonly id: string; readonly version: number } | null,
): string {
  if (vehiclePlan === undefined || vehiclePlan.state === 'not_known') return `The server does not know which plan is on ${name}.`;
  if (vehiclePlan.state === 'another') return `The plan on ${name} is not the plan that this server last uploaded.`;
  if (isOnVehicle(vehiclePlan, editedVersion)) return `This plan is on ${name}.`;
  const storedPlan =
    editedVersion !== null && vehiclePlan.plan?.id === editedVersion.id
      ? `version ${vehiclePlan.plan.version ?? 0} of this plan`
      : vehiclePlan.plan?.name == null
        ? 'an unnamed plan'
        : `the plan “${vehiclePlan.plan.name}”`;
  return `On ${name}: ${storedPlan}.`;
}

/** The reported state as a key. After a change of the key, the page requests the server's view of the plan again. */
export function reportedState(status: Status | null, mission: Schemas['Mission'] | null, flight: WaypointFlight | null): string {
  return JSON.stringify([status?.armed, status?.mode, mission?.current, mission?.mission_id, flight?.state, flight?.started_unix_s]);
}

/** Whether exactly this version is on the vehicle. */
export function isOnVehicle(vehiclePlan: VehiclePlan | undefined, version: { readonly id: string; readonly version: number } | null): boolean {
  const plan = vehiclePlan?.state === 'plan' ? vehiclePlan.plan : null;
  return version !== null && plan?.id === version.id && plan.version === version.version;
}

/** Text about the comparison of the plan that was read back from the vehicle with the edited plan. */
export function comparisonText(name: string, { equal, differences, still_held }: Comparison): string {
  if (still_held === false) return `The plan on ${name} has changed since it was read. Read it back again.`;
  if (equal && differences.length === 0) return `Read back: the plan on ${name} is identical to this plan.`;
  if (equal)
    return `Read back: the plan on ${name} matches this plan, but the vehicle does not store ${differences.length === 1 ? 'this value' : `these ${differences.length} values`}:`;
  return `Read back: the plan on ${name} differs from this plan:`;
}

export function differenceText({ part, seq, field, planned, held }: Difference): string {
  const [plannedText, heldText] = [valueText(field, planned), valueText(field, held)];
  if (seq === null) return `The ${PART_NAMES[part]}: ${plannedText} items in the plan, ${heldText} on the vehicle.`;
  const isLatLonValue = isCoordinate(field, planned) || isCoordinate(field, held);
  const fieldText = field === 'x' ? (isLatLonValue ? 'latitude' : 'parameter 5') : field === 'y' ? (isLatLonValue ? 'longitude' : 'parameter 6') : null;
  return `Item ${seq + 1} of the ${PART_NAMES[part]}, ${fieldText ?? FIELD_NAMES[field] ?? field.replace('param', 'parameter ')}: ${plannedText} in the plan, ${heldText} on the vehicle.`;
}

/** MAVLink sends positions in 1e-7 degrees. Items without a position have small numbers in these fields. */
function isCoordinate(field: string, value: number | null): boolean {
  return (field === 'x' || field === 'y') && value !== null && Math.abs(value) > 1000;
}

function valueText(field: string, value: number | null): string {
  if (value === null) return 'not set';
  if (field === 'frame') return ALTITUDE_REFERENCES[value] ?? `MAV_FRAME ${value}`;
  if (isCoordinate(field, value)) return `${fixed(value / 1e7, 7)}°`;
  return field === 'z' ? heightText(value) : String(Number(value.toFixed(4)));
}
