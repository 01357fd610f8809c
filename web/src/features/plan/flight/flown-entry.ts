/** The entry of the plan's list that the selected vehicle is flying now, if it flies exactly the edited plan. */

import { page } from '../../../app/page.svelte';
import type { VehicleFacts } from '../../../vehicle/facts';
import { plans, vehicleMission } from '../controllers';
import type { ListEntry } from '../document/list-entries';
import { simpleItems } from '../document/document';
import { hasEnded, type MissionFlight } from '../offboard/mission-flight';
import { fliesMission, type WaypointFlight } from './mission-start';
import type { Mission } from './plan-in-fly.svelte';

export interface FlownEntry {
  /** Row of a waypoint plan; null: an offboard mission. */
  readonly row: number | null;
  /** Place of a step of an offboard mission: "step 3". */
  readonly place: string | null;
}

export function isFlown(entry: Pick<ListEntry, 'row' | 'stepPlace'>, flown: FlownEntry | null): boolean {
  if (flown === null) return false;
  return flown.row === null ? entry.stepPlace !== undefined && entry.stepPlace === flown.place : entry.row === flown.row;
}

/** Null: the vehicle does not fly, or flies another plan than the edited one. Read reactively. */
export function flownEntry(facts: VehicleFacts): FlownEntry | null {
  const saved = plans.saved ? plans.savedPlan : null;
  if (saved === null || facts.replayed || !facts.inAir) return null;
  const vehicle = page.store.vehicles.get(facts.id);
  const flight = vehicle?.readAs<MissionFlight>('offboard_mission', facts.now_unix_s)?.value ?? null;
  if (flight !== null && !hasEnded(flight) && flight.plan_id === saved.id && flight.version === saved.version) return { row: null, place: flight.place };
  const current = vehicle?.readAs<Mission>('mission', facts.now_unix_s)?.value.current ?? null;
  if (
    current === null ||
    !fliesMission(facts.status?.value ?? null, vehicle?.readAs<WaypointFlight>('waypoint_flight', facts.now_unix_s)?.value ?? null) ||
    !vehicleMission.hasVersion(saved.id, saved.version)
  )
    return null;
  const row = 'items' in saved.plan ? simpleItems(saved.plan)[current]?.row : undefined;
  return row === undefined ? null : { row, place: null };
}
