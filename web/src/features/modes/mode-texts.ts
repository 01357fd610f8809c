/** What each flight mode does, why one cannot be selected now, and how one is selected. Pure functions. */

import type { components } from '../../api/schema';
import { actionFacts, reasonUnavailable, type ActionName, type ConfirmationTexts } from '../../app/actions/actions';
import { heightText } from '../../ui/format';
import type { VehicleFacts } from '../../vehicle/facts';

export type ModeChoice = components['schemas']['ModeChoice'];

/** Modes with a command of their own, which asks for what the mode needs; Hold needs no confirmation. */
const ACTIONS: Readonly<Record<string, ActionName>> = { hold: 'hold', land: 'land', rtl: 'rtl', takeoff: 'takeoff', offboard: 'offboard_start' };

/** Effect of a mode, as a sentence about the vehicle; `stick`: a pilot flies it with RC transmitter or joystick. */
const EFFECTS: Readonly<Record<string, { readonly text: string; readonly stick?: boolean; readonly danger?: boolean }>> = {
  hold: { text: 'Stops and holds its position.' },
  land: { text: 'Descends at its current position, lands and disarms.' },
  rtl: { text: 'Flies back to home, or to a rally point, and lands.' },
  takeoff: { text: 'Climbs to a height above home and holds there.' },
  mission: { text: 'Flies the mission stored on it, from the current item.' },
  offboard: { text: 'Follows setpoints that the server streams; begins at its position.' },
  orbit: { text: 'Circles around a point.' },
  follow: { text: 'Follows a target that sends its position over MAVLink; climbs above the ground first.' },
  precision_land: { text: 'Lands on a marker if it has a sensor for one, otherwise like Land.' },
  position: { text: 'The pilot’s sticks set the speed; with centred sticks it holds its position.', stick: true },
  position_slow: { text: 'Like Position, with lower speeds.', stick: true },
  altitude: { text: 'The pilot’s sticks set tilt and climb; it drifts with the wind.', stick: true },
  altitude_cruise: { text: 'Like Altitude, but keeps its tilt with centred sticks.', stick: true, danger: true },
  stabilized: { text: 'The pilot’s sticks set tilt and thrust; it holds neither altitude nor position.', stick: true, danger: true },
  manual: { text: 'The pilot’s sticks set tilt and thrust; it holds neither altitude nor position.', stick: true, danger: true },
  acro: { text: 'The pilot’s sticks set turning rates and thrust; it does not level itself.', stick: true, danger: true },
};
const EXTERNAL = { text: 'Flown by another program or a mission, which registered this mode.' };
const OTHER = { text: 'A mode of the vehicle.' };

export interface ModeRow extends ModeChoice {
  readonly isCurrent: boolean;
  readonly effect: string;
  /** Why the mode cannot be selected now; null: it can. */
  readonly whyNot: string | null;
  /** Why the vehicle cannot fly the mode, although it can be selected: the vehicle is disarmed. Null: it can, or it is not known. */
  readonly caution: string | null;
}

export interface ModeGroup {
  readonly title: string;
  readonly rows: readonly ModeRow[];
}

function effectOf(mode: string): { readonly text: string; readonly stick?: boolean; readonly danger?: boolean } {
  return EFFECTS[mode] ?? (mode.startsWith('external_') ? EXTERNAL : OTHER);
}

/** The action of the page that selects a mode; null: the mode is selected as any other. */
export function actionOf(mode: string): ActionName | null {
  return ACTIONS[mode] ?? null;
}

function row(choice: ModeChoice, facts: VehicleFacts): ModeRow {
  const reasons = choice.reasons.join(' ');
  const action = actionOf(choice.mode);
  // A disarmed PX4 accepts nearly every mode. What an action of the page needs, the action says itself.
  const isRefused = choice.can_run === false && facts.status?.value.armed === true && action === null;
  const unavailable = reasonUnavailable(action ?? 'offboard_start', { ...actionFacts(facts, 0), lost: facts.lost, replayed: facts.replayed });
  const whyNot = unavailable ?? (!choice.settable || isRefused ? reasons : null);
  const caution = whyNot === null && choice.can_run === false && action === null ? reasons : null;
  return { ...choice, isCurrent: facts.status?.value.mode === choice.mode, effect: effectOf(choice.mode).text, whyNot, caution };
}

/** The modes as a person looks for them, in the vehicle's order within each group; empty groups are left out. */
export function modeGroups(modes: readonly ModeChoice[], facts: VehicleFacts): ModeGroup[] {
  const rows = modes.map((choice) => row(choice, facts));
  const isStick = ({ mode }: ModeRow): boolean => effectOf(mode).stick === true;
  const isExternal = ({ mode }: ModeRow): boolean => mode.startsWith('external_');
  const groups = [
    { title: 'Flies by itself', rows: rows.filter((each) => !isStick(each) && !isExternal(each)) },
    { title: 'External modes', rows: rows.filter(isExternal) },
    { title: 'Flown by a pilot with RC transmitter or joystick', rows: rows.filter(isStick) },
  ];
  return groups.filter((group) => group.rows.length > 0);
}

/** The confirmation of a mode: what the vehicle does in it. */
export function modeTexts({ mode, label, caution }: ModeRow, facts: VehicleFacts): ConfirmationTexts {
  const { text, danger = false } = effectOf(mode);
  const alt_m = facts.globalPosition?.value.alt_home_m ?? null;
  const now = facts.inAir ? ` It flies at ${heightText(alt_m)} above home now.` : ' It is on the ground.';
  const stream = facts.offboard?.streaming === true ? ' Offboard ends.' : '';
  const cannot = caution === null ? '' : ` It cannot fly in this mode now: ${caution}`;
  return { title: `Mode ${label}: ${facts.name}`, effect: `${text}${now}${stream}${cannot}`, verb: label, danger: danger && facts.inAir };
}
