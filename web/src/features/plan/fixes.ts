/** Fixes that the page can make for a finding. Pure: returns a changed plan, or null if a person has to decide. */

import type { components } from '../../api/schema';
import { DEFAULT_ALTITUDE, isPlaced, path, type PlannedHome, type Plan } from './document';
import { insertItem, remove, removeZone, reorder, setItem } from './edit';
import { newItem } from './items';

export type Finding = Readonly<components['schemas']['FindingModel']>;

export interface Fix<D = Plan> {
  /** Text of the button. */
  readonly text: string;
  readonly plan: D;
}

/** The operator's altitude limit, as in the server's check [m above home]. */
const HIGHEST_M = 120;

/** @param home home of the vehicle; null if it is not known. */
export function fixOf(plan: Plan, finding: Finding, home: PlannedHome | null): Fix | null {
  const { row, zone } = finding.place;
  const item = row === null ? undefined : plan.items[row];
  switch (finding.code) {
    case 'home_missing':
      return home === null ? null : { text: 'Use the vehicle’s home', plan: { ...plan, planned_home: home } };
    case 'takeoff_missing':
      return takeoff(plan);
    case 'takeoff_not_first': {
      const first = plan.items.findIndex((one) => one.kind === 'takeoff');
      return first <= 0 ? null : { text: 'Move the take-off to the beginning', plan: reorder(plan, [first], 0).plan };
    }
    case 'landing_missing':
    case 'takeoff_landing_mismatch':
      return plan.items.some((one) => one.kind === 'takeoff')
        ? { text: 'Return at the end', plan: insertItem(plan, plan.items.length, newItem('return_home', null, DEFAULT_ALTITUDE)) }
        : takeoff(plan);
    case 'altitude_too_high':
      return item === undefined || row === null || !isPlaced(item)
        ? null
        : { text: `Lower to ${HIGHEST_M} m above home`, plan: setItem(plan, row, { altitude: { value_m: HIGHEST_M, reference: 'home' } }) };
    case 'jump_endless':
      return item?.kind === 'jump' && row !== null ? { text: 'Repeat once', plan: setItem(plan, row, { repeat: 1 }) } : null;
    case 'items_never_reached': {
      const end = plan.items.findIndex((one) => one.kind === 'return_home' || one.kind === 'land' || one.kind === 'loiter_unlimited');
      const after = plan.items.flatMap((_, i) => (i > end ? [`item:${i}`] : []));
      return end < 0 || after.length === 0 ? null : { text: `Delete the steps after step ${end + 1}`, plan: remove(plan, after) };
    }
    case 'command_refused':
    case 'vtol_item':
    case 'jump_target_missing':
    case 'jump_stalls':
      return row === null || item === undefined ? null : { text: `Delete step ${row + 1}`, plan: remove(plan, [`item:${row}`]) };
    case 'fence_invalid':
      return zone === null ? null : { text: 'Delete this fence', plan: removeZone(plan, zone) };
    default:
      return null;
  }
}

/** Adds a take-off at the plan's start, to the altitude of its first point. */
function takeoff(plan: Plan): Fix | null {
  const first = path(plan)[0]?.item;
  const at = plan.planned_home ?? first;
  if (at === undefined || at === null) return null;
  return { text: 'Take off at the beginning', plan: insertItem(plan, 0, newItem('takeoff', at, first?.altitude ?? DEFAULT_ALTITUDE)) };
}
