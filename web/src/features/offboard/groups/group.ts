/** Texts and numbers about a group, from the server's data. Pure functions. */

import type { components } from '../../../api/schema';
import { inSentence } from '../../../app/language';
import type { VehicleFacts } from '../../../vehicle/facts';
import type { Identity } from '../../../live/vehicle-state';
import { fixed, lengthText } from '../../../ui/format';
import { setpointsText } from '../../../vehicle/setpoint-kinds';
import { groundDistance_m } from '../../../vehicle/geo';

export type Group = components['schemas']['Group'];
export type Member = Group['members'][number];
export type Tone = 'ok' | 'target' | 'caution' | 'danger' | 'dim';

/** A group, and the time of this page's clock at which the page received it; countdowns start from this time. */
export interface ReceivedGroup {
  group: Group;
  receivedAt_s: number;
}

/** A unique key of a group. Group numbers begin again when the server restarts, so the key also contains the creation time. */
export function groupKey(group: Group): string {
  return `${group.id} ${group.created_unix_s}`;
}

/** Whether the group has not ended. */
export function isActive(group: Group): boolean {
  return group.state !== 'ended';
}

/** The group in an event; null if the event has no valid group. */
export function readGroup(value: unknown): Group | null {
  const group = value as Group | null;
  return typeof group === 'object' && group !== null && typeof group.id === 'string' && Array.isArray(group.members) && Array.isArray(group.findings)
    ? group
    : null;
}

/** The list with one group updated, in the server's order. */
export function withGroup(groups: readonly ReceivedGroup[], received: ReceivedGroup): ReceivedGroup[] {
  const key = groupKey(received.group);
  const exists = groups.some((entry) => groupKey(entry.group) === key);
  return exists ? groups.map((entry) => (groupKey(entry.group) === key ? received : entry)) : [...groups, received];
}

/** The newest ended group that had started and that this page has seen active. @param seenActiveKeys keys of the groups seen active and not dismissed. */
export function newestEnded(groups: readonly ReceivedGroup[], seenActiveKeys: ReadonlySet<string>): Group | null {
  const endedGroups = groups.map((entry) => entry.group).filter((g) => !isActive(g) && g.start_unix_s !== null && seenActiveKeys.has(groupKey(g)));
  return endedGroups[endedGroups.length - 1] ?? null;
}

/** MAV_TYPE numbers of the multicopters that the server commands: quadrotor, coaxial, hexa-, octo-, tri-, dodeca-, decarotor. */
const MULTICOPTERS: readonly (number | null)[] = [2, 3, 13, 14, 15, 29, 35];
const MAV_AUTOPILOT_PX4 = 12;

export function isCommandable(identity: Identity): boolean {
  return !identity.replayed && identity.autopilot === MAV_AUTOPILOT_PX4 && MULTICOPTERS.includes(identity.vehicle_type);
}

export function stateLabel(group: Group, now_unix_s: number): { text: string; tone: Tone } {
  switch (group.state) {
    case 'starting':
      return { text: 'Starting: all switch to Offboard', tone: 'target' };
    case 'waiting': {
      const untilStart_s = group.start_unix_s === null ? null : Math.max(0, group.start_unix_s - now_unix_s);
      return { text: `Waiting, starts in ${fixed(untilStart_s, 1)} s`, tone: 'target' };
    }
    case 'flying':
      return { text: group.mission === null ? 'Flying' : `Flying the mission “${group.mission}”`, tone: 'ok' };
    case 'holding':
      return { text: 'Switching to Hold', tone: 'caution' };
    case 'ended':
      return { text: 'Ended', tone: 'dim' };
  }
}

const STREAM_TEXTS: Readonly<Record<string, string>> = {
  idle: 'no stream',
  starting: 'switching to Offboard',
  interrupted: 'interrupted by its failsafe: holds its position',
  holding: 'expired: holds its position',
  to_hold: 'switches to Hold',
  landing: 'expired: lands',
  undoing: 'start failed: the server stops the stream',
};

/** Label of a member: its role in a mission, or the state of its stream, and its reported mode. */
export function memberLabel(member: Member, modeLabel: string | null, isStarting = false): { text: string; tone: Tone } {
  const mode = modeLabel ?? member.mode;
  if (member.role !== null && !member.held) return { text: `${member.role} · ${mode}`, tone: 'dim' };
  const stream = STREAM_TEXTS[member.stream] ?? inSentence(setpointsText(member.ordered_type));
  if (isStarting && member.stream === 'streaming') return { text: `waiting · ${mode}`, tone: 'dim' };
  if (member.held) return { text: member.mode === 'hold' ? 'in Hold' : `left the group · ${mode}`, tone: 'caution' };
  return { text: `${stream} · ${mode}`, tone: member.stream === 'streaming' || member.stream === 'starting' ? 'dim' : 'caution' };
}

/** Remaining validity of the group's setpoints [s]; null if the server streams no setpoints to the group. */
export function validLeft_s({ group, receivedAt_s }: ReceivedGroup, now_s: number): number | null {
  return group.valid_left_s === null ? null : Math.max(0, group.valid_left_s - (now_s - receivedAt_s));
}

/** The newest findings, newest first, without a finding that only repeats why the group ended. */
export function findingsShown(group: Group, max: number): Group['findings'] {
  return group.findings
    .slice(-max)
    .reverse()
    .filter((finding) => finding.text !== group.ended);
}

/** The minimum separation that the server monitors, and the margin that the server adds for uncertain positions. */
export function separationText(group: Group): string {
  const minimum = `minimum ${lengthText(group.minimum_separation_m)}`;
  return group.margin_m === null ? minimum : `${minimum} + ${lengthText(group.margin_m)} margin`;
}

/** The distance is shown in amber below this factor times the minimum separation. */
const CAUTION_FACTOR = 1.25;

export function distanceTone(distance_m: number, minimum_m: number): Tone {
  return distance_m < minimum_m ? 'danger' : distance_m < CAUTION_FACTOR * minimum_m ? 'caution' : 'ok';
}

/** The two vehicles that are closest to each other, by their global positions; null if fewer than two positions are known. */
export function nearestPair(vehicles: readonly VehicleFacts[]): { vehicles: [string, string]; distance_m: number } | null {
  let nearest: { vehicles: [string, string]; distance_m: number } | null = null;
  vehicles.forEach((a, i) =>
    vehicles.slice(i + 1).forEach((b) => {
      if (a.globalPosition === null || b.globalPosition === null || a.globalPosition.stale || b.globalPosition.stale) return;
      const distance_m = Math.hypot(
        groundDistance_m(a.globalPosition.value, b.globalPosition.value),
        a.globalPosition.value.alt_amsl_m - b.globalPosition.value.alt_amsl_m,
      );
      if (Number.isFinite(distance_m) && (nearest === null || distance_m < nearest.distance_m)) nearest = { vehicles: [a.id, b.id], distance_m };
    }),
  );
  return nearest;
}

/** The names as one text, for example "Quad 1, Quad 2 and Hexa 3". */
export function joinNames(names: readonly string[]): string {
  return names.length < 2 ? names.join('') : `${names.slice(0, -1).join(', ')} and ${names[names.length - 1] ?? ''}`;
}
