/** The group form: its values, the errors by field, and the API request made from the values. Pure functions. */

import type { components } from '../../../api/schema';
import type { VehicleFacts } from '../../../vehicle/facts';
import { fixed, joinedText, lengthText, shown } from '../../../ui/format';
import type { ConfirmationTexts } from '../../../app/actions/actions';
import { ON_EXPIRY, type AnySetpoint, type Validity } from '../../../vehicle/setpoint';
import { boundsOf, limitProblem, parseTyped, type Limits } from '../../../vehicle/fields';
import { joinNames, type Group } from './group';

export type GroupMotion = 'move' | 'velocity';

export interface Draft {
  /** Vehicle ids, in the order in which the person chose them. */
  members: readonly string[];
  motion: GroupMotion;
  /** North, east, up as typed: [m] or [m/s]. */
  axes: Readonly<Record<GroupMotion, readonly string[]>>;
  valid_s: Readonly<Record<GroupMotion, string>>;
  renew: Readonly<Record<GroupMotion, boolean>>;
  separation_m: string;
  /** Time until the group moves; empty: it moves as soon as all members are in Offboard mode. */
  startIn_s: string;
  othersContinue: boolean;
}

/** By default the page renews position setpoints while it is visible, and does not renew velocities. */
export const NEW_DRAFT: Draft = {
  members: [],
  motion: 'move',
  axes: { move: ['0', '0', '0'], velocity: ['0', '0', '0'] },
  valid_s: { move: '10', velocity: '5' },
  renew: { move: true, velocity: false },
  separation_m: '5',
  startIn_s: '',
  othersContinue: false,
};

export const AXES = ['North', 'East', 'Up'] as const;
const MAX_MEMBERS = 10;

/** The API's limits, but with a minimum validity of 0.5 s instead of 0.05 s, because the page sends a group's setpoints over HTTP. */
const RANGES = {
  valid: { ...boundsOf('StartGroup', 'valid_for_s'), min: 0.5 },
  separation: boundsOf('StartGroup', 'minimum_separation_m'),
  start: { min: 3, max: 300 },
} as const;

export type FieldErrors = Readonly<Record<string, string>>;

function rangeError(text: string, limits: Limits, unit: string): string | null {
  return limitProblem(parseTyped(text) ?? NaN, limits, unit);
}

/** Errors by field. For a flying group, only the errors of fields that can change a flying group. */
export function fieldErrors(draft: Draft, isFlying: boolean): FieldErrors {
  const errors: Record<string, string> = {};
  const add = (field: string, error: string | null): void => void (error !== null && (errors[field] = error));
  AXES.forEach((axis, i) => add(`axis${i}`, parseTyped(draft.axes[draft.motion][i] ?? '') === null ? `${axis}: enter a number.` : null));
  add('valid', rangeError(draft.valid_s[draft.motion], RANGES.valid, 's'));
  if (isFlying) return errors;
  if (draft.members.length < 2) add('members', 'Choose two vehicles or more.');
  if (draft.members.length > MAX_MEMBERS) add('members', `A group has ${MAX_MEMBERS} vehicles at most.`);
  add('separation', rangeError(draft.separation_m, RANGES.separation, 'length'));
  if (draft.startIn_s.trim() !== '') add('start', rangeError(draft.startIn_s, RANGES.start, 's')?.replace('.', '; leave empty to start immediately.') ?? null);
  return errors;
}

/** The quantity (`ui/units.ts`) of an axis: north, east, up. */
export function axisUnit(motion: Draft['motion'], axis: number): string {
  if (axis === 2) return motion === 'move' ? 'height' : 'climb';
  return motion === 'move' ? 'length' : 'speed';
}

/** North, east, up as numbers. */
function typedVector(draft: Draft): [number, number, number] {
  return draft.axes[draft.motion].map((text) => parseTyped(text) ?? 0) as [number, number, number];
}

export function validityOf(draft: Draft): Validity {
  return { valid_for_s: parseTyped(draft.valid_s[draft.motion]) ?? 0, on_expiry: ON_EXPIRY, renew: draft.renew[draft.motion] };
}

/** The setpoint of a vehicle in its local frame; null for an offset if the vehicle's position is not known. */
export function setpointFor(facts: VehicleFacts, draft: Draft): AnySetpoint | null {
  const [north, east, up] = typedVector(draft);
  const yaw = facts.attitude === null || facts.attitude.stale ? {} : { yaw_ned_rad: facts.attitude.value.yaw_ned_rad };
  if (draft.motion === 'velocity') return { type: 'velocity', velocity_ned_m_s: [north, east, -up + 0], ...yaw };
  if (facts.localPosition === null || facts.localPosition.stale) return null;
  const [n, e, d] = facts.localPosition.value.position_ned_m;
  return { type: 'position', position_ned_m: [n + north, e + east, d - up], ...yaw };
}

/** The motion of a flying group's setpoints, so that a renewal uses the form's validity for this motion. */
export function motionOf(group: Group): GroupMotion {
  return group.members.every((member) => member.ordered_type.startsWith('position')) ? 'move' : 'velocity';
}

/** A member and its setpoint. */
export interface MemberSetpoint {
  vehicle: string;
  setpoint: AnySetpoint;
}

export type GroupBody = Omit<components['schemas']['StartGroup'], 'members'> & { members: readonly MemberSetpoint[] };

export type SetpointsResult = { ok: true; setpoints: MemberSetpoint[] } | { ok: false; detail: string };

/** The setpoints of all vehicles, or a text that names the vehicles without a known position. */
export function setpointsFor(vehicles: readonly VehicleFacts[], draft: Draft): SetpointsResult {
  const setpoints: MemberSetpoint[] = [];
  const withoutPosition: string[] = [];
  for (const facts of vehicles) {
    const setpoint = setpointFor(facts, draft);
    if (setpoint === null) withoutPosition.push(facts.name);
    else setpoints.push({ vehicle: facts.id, setpoint });
  }
  if (withoutPosition.length === 0) return { ok: true, setpoints };
  return {
    ok: false,
    detail: `${joinNames(withoutPosition)} ${withoutPosition.length === 1 ? 'reports' : 'report'} no local position now, so the offset has no reference.`,
  };
}

/** The body that starts a group. The start time is `now_unix_s`, by the server's clock, plus the typed time. */
export function startBody(setpoints: readonly MemberSetpoint[], draft: Draft, now_unix_s: number): GroupBody {
  const { valid_for_s, on_expiry } = validityOf(draft);
  const startIn_s = parseTyped(draft.startIn_s);
  return {
    members: setpoints,
    minimum_separation_m: parseTyped(draft.separation_m) ?? 0,
    valid_for_s,
    on_expiry,
    others_go_on: draft.othersContinue,
    ...(startIn_s === null ? {} : { start_at_unix_s: now_unix_s + startIn_s }),
  };
}

/** The server's text with the form's field names instead of the API's names. */
export function formText(text: string): string {
  return text.replaceAll('minimum_separation_m', '“Minimum separation”').replaceAll('start_at_unix_s', '“Start in”').replaceAll('valid_for_s', '“Valid for”');
}

const DIRECTION_WORDS: readonly (readonly [string, string])[] = [
  ['north', 'south'],
  ['east', 'west'],
  ['up', 'down'],
];

/** A group's setpoint as a line of the sent ones. @param names of its vehicles, joined */
export function groupText(names: string, draft: Draft): string {
  return `Group of ${names}: ${motionText(draft)}`;
}

/** The motion as text, for example "move 5.0 m north, 2.0 m down". */
export function motionText(draft: Draft): string {
  const parts = typedVector(draft)
    .map((value, i) =>
      Math.abs(value) < 0.05 ? null : `${joinedText(shown(axisUnit(draft.motion, i), Math.abs(value)))} ${DIRECTION_WORDS[i]?.[value > 0 ? 0 : 1] ?? ''}`,
    )
    .filter((p) => p !== null);
  if (parts.length === 0) return draft.motion === 'move' ? 'hold their positions' : 'hover (zero velocity)';
  return `${draft.motion === 'move' ? 'move' : 'fly'} ${parts.join(', ')}`;
}

/** The confirmation's texts for the start of a group: vehicles, action and effect. */
export function startTexts(names: readonly string[], draft: Draft): ConfirmationTexts {
  const startText = parseTyped(draft.startIn_s) === null ? 'Then' : `In ${fixed(parseTyped(draft.startIn_s), 0)} s`;
  const { valid_for_s, renew } = validityOf(draft);
  const validityText = renew ? 'This page renews the setpoints while it is visible' : `After ${fixed(valid_for_s, 1)} s all hold position, then switch to Hold`;
  return {
    title: `Start group: ${joinNames(names)}`,
    effect: `All vehicles switch to Offboard at their current positions. ${startText} all ${motionText(draft)} together. If two vehicles come closer than ${lengthText(parseTyped(draft.separation_m))}, ${draft.othersContinue ? 'only these two switch to Hold' : 'all switch to Hold'}. ${validityText}. “Hold group” switches all to Hold at any time.`,
    verb: 'Start',
    danger: false,
  };
}
