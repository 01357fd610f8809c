/** Following another vehicle by an Offboard stream: its setpoint, its effect before and its progress after. Pure functions. */

import { distanceText, heightText, shortText } from '../../ui/format';
import { DEFAULT_VALIDITY, type AnySetpoint, type StreamStart } from '../../vehicle/setpoint';
import { expiryText } from '../../vehicle/offboard';
import type { VehicleFacts } from '../../vehicle/facts';
import { groundDistance_m } from '../../vehicle/geo';

export type FollowNose = 'keep' | 'same' | 'face';

export const FOLLOW_NOSE_NAMES: Readonly<Record<FollowNose, string>> = {
  keep: 'Unchanged',
  same: 'As the followed vehicle',
  face: 'Towards the followed vehicle',
};

/** Whom to follow, and where beside it. */
export interface Following {
  /** Distance behind the followed vehicle, along its heading [m]. */
  readonly behind_m: number;
  /** Height above it [m]; negative: below. */
  readonly above_m: number;
  readonly nose: FollowNose;
}

/** Smallest distance to a followed vehicle [m]; the server refuses a smaller one. */
const MIN_AWAY_M = 2;
const RATE_HZ = 50;

/** Why the vehicle cannot follow now; null: it can. */
export function whyNotFollow({ behind_m, above_m }: Following, facts: VehicleFacts, leader: VehicleFacts | null): string | null {
  if (leader === null) return 'Choose the vehicle to follow.';
  if (leader.lost || leader.globalPosition === null || leader.globalPosition.stale) return `The position of ${leader.name} is not known.`;
  if (facts.offboard?.streaming === true) return 'The vehicle follows setpoints: Hold first, or change them in the Offboard view.';
  return Math.hypot(behind_m, above_m) < MIN_AWAY_M ? `At least ${shortText('length', MIN_AWAY_M)} between the vehicles.` : null;
}

function besideText({ behind_m, above_m }: Following): string {
  const level = behind_m === 0 ? '' : `${shortText('length', Math.abs(behind_m))} ${behind_m > 0 ? 'behind' : 'ahead'}`;
  const height = above_m === 0 ? '' : `${shortText('height', Math.abs(above_m))} ${above_m > 0 ? 'above' : 'below'}`;
  return [level, height].filter(Boolean).join(', ');
}

/** What the vehicle does, as a sentence with numbers. */
export function followText(following: Following, facts: VehicleFacts, leader: VehicleFacts): string {
  const [own, other] = [facts.globalPosition?.value, leader.globalPosition?.value];
  const away = own === undefined || other === undefined ? '' : `, ${distanceText(groundDistance_m(own, other))} away now`;
  return `Flies to ${leader.name}${away}, and stays ${besideText(following)} in Offboard, also when it turns, until Hold. It is never sent below known ground. If ${leader.name} sends no position for a second, the vehicle holds.`;
}

/** The stream that follows; the page renews it as long as it is open. */
export function followStart(following: Following, leader: VehicleFacts, onOutcome: StreamStart['onOutcome']): StreamStart {
  const setpoint: AnySetpoint = {
    type: 'follow',
    vehicle: leader.id,
    offset_frd_m: [-following.behind_m, 0, -following.above_m],
    yaw: following.nose,
  };
  const text = `follows ${leader.name}, ${besideText(following)}, renewed while this page is open. If it is not renewed for ${DEFAULT_VALIDITY.valid_for_s} s, ${expiryText({ ...DEFAULT_VALIDITY.on_expiry })}`;
  return { setpoint, validity: DEFAULT_VALIDITY, rate_hz: RATE_HZ, text, ...(onOutcome === undefined ? {} : { onOutcome }) };
}

/** How following goes on. @param leaderName as it was when the command was given */
export function followProgress(facts: VehicleFacts, leader: VehicleFacts | null, leaderName: string): { text: string; ended: boolean } {
  const label = facts.status?.value.mode_label ?? '';
  if (facts.offboard?.streaming !== true || facts.offboard.requestedType !== 'follow')
    return { text: `Following has ended: the vehicle is in ${label}.`, ended: true };
  const [own, other] = [facts.globalPosition?.value, leader?.globalPosition?.value];
  if (own === undefined || other === undefined) return { text: `Follows ${leaderName}, whose position is not known.`, ended: false };
  const above_m = own.alt_amsl_m - other.alt_amsl_m;
  const height = `${heightText(Math.abs(above_m), 1)} ${above_m < 0 ? 'below' : 'above'}`;
  return { text: `Follows ${leaderName}: ${distanceText(groundDistance_m(own, other))} away, ${height} it.`, ended: false };
}
