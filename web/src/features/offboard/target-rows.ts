/** The displayed values of a target in the local frame, and the texts of their step buttons. Pure functions. */

import type { MaybeVector3 } from '../../live/topics';
import { fixed, shown } from '../../ui/format';

export interface TargetRow {
  name: string;
  /** The quantity and its reference. */
  title: string;
  text: string;
  unit: string;
  /** Text of the button that decreases the value by one step. */
  decreaseText: string;
  /** Text of the button that increases the value by one step. */
  increaseText: string;
}

/** Directions of a step that decreases and of one that increases the value of each axis. */
const STEP_WORDS: readonly (readonly [string, string])[] = [
  ['south', 'north'],
  ['west', 'east'],
  ['down', 'up'],
];

/**
 * Rows for north, east, up and yaw.
 * @param yaw_deg clockwise from north, 0 to 360.
 * @param names displayed names of the first three rows.
 * @param steps sizes of one step; `distance` is a text with its unit.
 */
export function targetRows(
  names: readonly [string, string, string],
  [north_m, east_m, down_m]: MaybeVector3,
  yaw_deg: number | null,
  steps: { distance: string; yaw_deg: number },
): TargetRow[] {
  const row = (name: string, title: string, quantity: string, value_m: number | null, axis: number): TargetRow => ({
    name,
    title,
    ...shown(quantity, value_m),
    decreaseText: `${steps.distance} ${STEP_WORDS[axis]?.[0]}`,
    increaseText: `${steps.distance} ${STEP_WORDS[axis]?.[1]}`,
  });
  return [
    row(names[0], 'North of the local origin', 'length', north_m, 0),
    row(names[1], 'East of the local origin', 'length', east_m, 1),
    row(names[2], 'Altitude above the local origin', 'height', down_m === null ? null : -down_m, 2),
    {
      name: 'Yaw',
      title: 'Yaw from north',
      text: fixed(yaw_deg, 0),
      unit: '°',
      decreaseText: `${steps.yaw_deg}° left`,
      increaseText: `${steps.yaw_deg}° right`,
    },
  ];
}
