/** Fixes that the page can make for a finding: a changed plan, or null if a person has to decide. Pure functions. */

import { shortText } from '../../../ui/format';
import type { components } from '../../../api/schema';
import { defaultAltitude, isPlaced, flownItems, type PlannedHome, type Plan } from './document';
import { insertItem, remove, removeObstacle, removeZone, reorder, setItem } from './edit';
import { newItem } from './items';

export type Finding = Readonly<components['schemas']['FindingModel']>;

export interface Fix<D = Plan> {
  /** Text of the button. */
  readonly text: string;
  readonly plan: D;
}

/** Value of `speed_m_s` for the vehicle's default speed (MAV_CMD_DO_CHANGE_SPEED). */
const VEHICLE_DEFAULT_SPEED = -2;

/** @param home home of the vehicle; null if it is not known. */
export function fixOf(plan: Plan, finding: Finding, home: PlannedHome | null): Fix | null {
  const { row, zone, obstacle } = finding.place;
  const item = row === null ? undefined : plan.items[row];
  switch (finding.code) {
    case 'home_missing':
      return home === null ? null : { text: 'Use the vehicle’s home', plan: { ...plan, planned_home: home } };
    case 'takeoff_missing':
      return addTakeoff(plan);
    case 'takeoff_not_first': {
      const takeoffRow = plan.items.findIndex(({ kind }) => kind === 'takeoff');
      return takeoffRow <= 0 ? null : { text: 'Move the take-off to the beginning', plan: reorder(plan, [takeoffRow], 0).plan };
    }
    case 'landing_missing':
      return addLanding(plan);
    case 'takeoff_landing_mismatch':
      return plan.items.some(({ kind }) => kind === 'takeoff') ? addLanding(plan) : addTakeoff(plan);
    case 'takeoff_too_low':
    case 'takeoff_low':
    case 'altitude_too_high':
    case 'altitude_fence':
      return setAltitude(plan, finding);
    case 'speed_too_high':
      return setSpeed(plan, finding);
    case 'speed_invalid':
      return row === null ? null : { text: 'Set the vehicle’s default speed', plan: setItem(plan, row, { speed_m_s: VEHICLE_DEFAULT_SPEED }) };
    case 'endurance_endless': {
      const jumpRow = plan.items.findIndex(({ kind, repeat }) => kind === 'jump' && Number(repeat) < 0);
      return jumpRow < 0 ? null : { text: `Set the repeats of item ${jumpRow + 1} to 1`, plan: setItem(plan, jumpRow, { repeat: 1 }) };
    }
    case 'jump_endless':
      return item?.kind === 'jump' && row !== null ? { text: 'Set the repeats to 1', plan: setItem(plan, row, { repeat: 1 }) } : null;
    case 'items_never_reached': {
      const laterIds = row === null ? [] : plan.items.flatMap((_, i) => (i > row ? [`item:${i}`] : []));
      return row === null || laterIds.length === 0 ? null : { text: `Delete the items after item ${row + 1}`, plan: remove(plan, laterIds) };
    }
    case 'complex_without_items':
    case 'command_refused':
    case 'vtol_item':
    case 'jump_target_missing':
    case 'jump_stalls':
      return row === null || item === undefined ? null : { text: `Delete item ${row + 1}`, plan: remove(plan, [`item:${row}`]) };
    case 'fence_invalid':
      return zone === null ? null : { text: 'Delete this geofence', plan: removeZone(plan, zone) };
    case 'obstacle_invalid':
      return obstacle === null ? null : { text: 'Delete this obstacle', plan: removeObstacle(plan, obstacle) };
    default:
      return null;
  }
}

/** Adds a take-off at home, or else at the first point, to the altitude of the first point. Null: the plan has neither home nor points. */
function addTakeoff(plan: Plan): Fix | null {
  const first = flownItems(plan)[0]?.item;
  const position = plan.planned_home ?? first;
  if (position === undefined || position === null) return null;
  return { text: 'Add a take-off at the beginning', plan: insertItem(plan, 0, newItem('takeoff', position, first?.altitude ?? defaultAltitude())) };
}

/** Adds a landing at home, or else at the last point. Null: the plan has neither, or ends with a return or an unlimited loiter. */
function addLanding(plan: Plan): Fix | null {
  const last = plan.items.at(-1);
  const position = plan.planned_home ?? flownItems(plan).at(-1)?.item;
  if (position === undefined || last?.kind === 'return_home' || last?.kind === 'loiter_unlimited') return null;
  const text = plan.planned_home == null ? 'Add a landing at the last point' : 'Add a landing at home';
  return { text, plan: insertItem(plan, plan.items.length, newItem('land', position, defaultAltitude())) };
}

/** Sets an item's altitude to the limit of the finding. */
function setAltitude(plan: Plan, { limit, place: { row } }: Finding): Fix | null {
  const item = row === null ? undefined : plan.items[row];
  if (item === undefined || row === null || limit === null || !isPlaced(item)) return null;
  return {
    text: `Set the altitude to ${shortText('height', limit)} above home`,
    plan: setItem(plan, row, { altitude: { value_m: limit, reference: 'home' } }),
  };
}

/** Sets the speed of the item to the limit of the finding; for a finding without an item, sets the speed of the plan. */
function setSpeed(plan: Plan, { limit, place: { row } }: Finding): Fix | null {
  if (limit === null) return null;
  const text = `Set the speed to ${shortText('speed', limit)}`;
  return { text, plan: row === null ? { ...plan, hover_speed_m_s: limit } : setItem(plan, row, { speed_m_s: limit }) };
}
