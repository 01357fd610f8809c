/** Texts about recordings; positions, marks and texts of the time bar. Pure functions. */

import type { components } from '../../api/schema';
import type { Replay } from '../../live/wire';

type Schemas = components['schemas'];
export type RecordingIndex = Schemas['RecordingIndex'];
export type VehicleMarks = RecordingIndex['vehicles'][number];
type MessageMark = VehicleMarks['messages'][number];

export const SPEEDS: readonly number[] = [0.25, 0.5, 1, 2, 4, 8, 16, 50];
const STEP_S = 5;
const LONG_STEP_S = 30;
/** MAV_SEVERITY of a warning: messages of this or higher severity are coloured, and a person can step to them. */
const WARNING = 4;
/** MAV_SEVERITY of an error. */
const ERROR = 3;

/** Start and end of a replay; null while the server is reading the recording: a seek is not possible then. */
export function replayBounds(replay: Replay): { begin_s: number; end_s: number } | null {
  return replay.begin_unix_s === null || replay.end_unix_s === null ? null : { begin_s: replay.begin_unix_s, end_s: replay.end_unix_s };
}

/** Whether a replay is at a requested time, or, if it plays, a little after this time. */
export function hasArrived(replay: Replay, requested_unix_s: number): boolean {
  const delay_s = replay.position_unix_s === null ? NaN : replay.position_unix_s - requested_unix_s;
  return delay_s >= -0.5 && delay_s <= 0.5 + (replay.playing ? 2 * Math.max(1, replay.speed) : 0);
}

/** Position of a time between begin and end, 0 to 1. */
export function fractionAt(unix_s: number, begin_s: number, end_s: number): number {
  return end_s > begin_s ? Math.min(1, Math.max(0, (unix_s - begin_s) / (end_s - begin_s))) : 0;
}

/** The marks of the selected vehicle, or else of the first vehicle. A second vehicle with system id 1 has the id `1~2`. */
export function marksOf(index: RecordingIndex | null, vehicleId: string | null): VehicleMarks | null {
  if (index === null) return null;
  const system = Number(vehicleId?.split('~')[0] ?? NaN);
  return index.vehicles.find((v) => v.system_id === system) ?? index.vehicles[0] ?? null;
}

export interface Span {
  /** Position and width on the bar, 0 to 1. */
  left: number;
  width: number;
  label: string;
  mode: string;
  begin_s: number;
}

export function modeSpans(marks: VehicleMarks | null, begin_s: number, end_s: number): Span[] {
  return (marks?.modes ?? []).map((m) => {
    const left = fractionAt(m.begin_unix_s, begin_s, end_s);
    return { left, width: fractionAt(m.end_unix_s, begin_s, end_s) - left, label: m.mode_label, mode: m.mode, begin_s: m.begin_unix_s };
  });
}

export interface Tick {
  /** Position on the bar, 0 to 1. */
  left: number;
  tone: 'danger' | 'caution' | 'neutral';
  text: string;
}

export function messageTicks(marks: VehicleMarks | null, begin_s: number, end_s: number): Tick[] {
  return (marks?.messages ?? []).map((m) => ({ left: fractionAt(m.unix_s, begin_s, end_s), tone: severityTone(m.severity), text: m.text }));
}

export function severityTone(severity: number): Tick['tone'] {
  return severity <= ERROR ? 'danger' : severity === WARNING ? 'caution' : 'neutral';
}

const SEVERITIES = ['Emergency', 'Alert', 'Critical', 'Error', 'Warning', 'Notice', 'Info', 'Debug'];

function messageText(message: MessageMark): string {
  return message.severity <= WARNING ? `${SEVERITIES[message.severity] ?? ''}: ${message.text}` : message.text;
}

/** Mode and arming state at a time, and the most severe message up to `range_s` before or after this time. Empty texts: none. */
export function stateAt(marks: VehicleMarks | null, unix_s: number, range_s: number): { mode: string; armed: boolean; message: string } {
  const isWithin = (span: { begin_unix_s: number; end_unix_s: number }): boolean => span.begin_unix_s <= unix_s && unix_s <= span.end_unix_s;
  const mode = marks?.modes.filter(isWithin).at(-1)?.mode_label ?? '';
  const nearbyMessages = (marks?.messages ?? []).filter((m) => Math.abs(m.unix_s - unix_s) <= range_s);
  const mostSevere = nearbyMessages.reduce<MessageMark | null>((worst, m) => (worst === null || m.severity < worst.severity ? m : worst), null);
  return { mode, armed: marks?.armed.some(isWithin) ?? false, message: mostSevere === null ? '' : messageText(mostSevere) };
}

/** Times of the marks to which a person can step: changes of mode and of the arming state, warnings and errors. */
export function markTimes(marks: VehicleMarks | null): number[] {
  if (marks === null) return [];
  const times = [
    ...marks.modes.map((m) => m.begin_unix_s),
    ...marks.armed.flatMap((a) => [a.begin_unix_s, a.end_unix_s]),
    ...marks.messages.filter((m) => m.severity <= WARNING).map((m) => m.unix_s),
  ];
  return [...new Set(times)].sort((a, b) => a - b);
}

/** The time of the first mark after `unix_s` (1) or of the last mark before `unix_s` (−1); null if there is none. */
export function adjacentMark(times: readonly number[], unix_s: number, direction: 1 | -1): number | null {
  const margin_s = 0.3; // skips the mark at the present position
  return (direction === 1 ? times.find((t) => t > unix_s + margin_s) : times.filter((t) => t < unix_s - margin_s).at(-1)) ?? null;
}

/** The time that a key on the bar selects; null for other keys. */
export function timeAfterKey(key: string, shift: boolean, at_s: number, begin_s: number, end_s: number): number | null {
  const step = shift ? LONG_STEP_S : STEP_S;
  switch (key) {
    case 'ArrowLeft':
    case 'ArrowDown':
      return Math.max(begin_s, at_s - step);
    case 'ArrowRight':
    case 'ArrowUp':
      return Math.min(end_s, at_s + step);
    case 'PageDown':
      return Math.max(begin_s, at_s - LONG_STEP_S);
    case 'PageUp':
      return Math.min(end_s, at_s + LONG_STEP_S);
    case 'Home':
      return begin_s;
    case 'End':
      return end_s;
    default:
      return null;
  }
}

/** The replay of the selected vehicle, or else the expected replay; if no vehicle is selected, also a replay without a vehicle. */
export function replayToShow(replays: readonly Replay[], selectedId: string | null, expectedName: string | null): Replay | null {
  const selectedReplay = selectedId === null ? undefined : replays.find((r) => r.vehicles.includes(selectedId));
  return selectedReplay ?? replays.find((r) => r.name === expectedName || (r.vehicles.length === 0 && selectedId === null)) ?? null;
}
