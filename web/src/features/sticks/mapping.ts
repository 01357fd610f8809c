/** Which axis of a gamepad is which stick, and what its buttons do. Pure functions. */

import type { components } from '../../api/schema';
import { shapeAxis, type PadSnapshot } from '../../vehicle/gamepad';

export const CONTROLS = ['pitch', 'roll', 'throttle', 'yaw', 'gimbal_pitch', 'gimbal_yaw'] as const;
export type Control = (typeof CONTROLS)[number];
/** The sticks without which nobody flies. */
export const FLIGHT_CONTROLS: readonly Control[] = ['pitch', 'roll', 'throttle', 'yaw'];
export const CONTROL_TEXTS: Readonly<Record<Control, string>> = {
  pitch: 'Pitch, forward',
  roll: 'Roll, right',
  throttle: 'Throttle, up',
  yaw: 'Yaw, clockwise',
  gimbal_pitch: 'Gimbal, up',
  gimbal_yaw: 'Gimbal, right',
};

type GamepadSettings = components['schemas']['Gamepad'];
export type ButtonAction = components['schemas']['GamepadButton']['action'];
export const ACTION_TEXTS: Readonly<Record<ButtonAction, string>> = {
  hold: 'Hold',
  stop: 'Stop flying by stick',
  go_on: 'Fly on',
  land: 'Land (asks)',
  arm: 'Arm (asks)',
};

export interface AxisChoice {
  /** Null: no axis. */
  axis: number | null;
  reverse: boolean;
}

export interface Mapping {
  axes: Readonly<Record<Control, AxisChoice>>;
  deadZone: number;
  expo: number;
  gimbalRate_deg_s: number;
  buttons: readonly { button: number; action: ButtonAction }[];
}

const axis = (number: number, reverse = false): AxisChoice => ({ axis: number, reverse });
/** Axes of the standard gamepad: 0 and 1 are the left stick, 2 and 3 the right one; down is positive. */
export const PRESETS: readonly { name: string; axes: Readonly<Partial<Record<Control, AxisChoice>>> }[] = [
  { name: 'Mode 1', axes: { pitch: axis(1, true), yaw: axis(0), throttle: axis(3, true), roll: axis(2) } },
  { name: 'Mode 2', axes: { throttle: axis(1, true), yaw: axis(0), pitch: axis(3, true), roll: axis(2) } },
];
const MODE_2 = PRESETS[1]?.axes ?? {};
const NO_AXIS: AxisChoice = { axis: null, reverse: false };

/** The mapping that a person has set; what is missing has its default. */
export function mappingOf(settings: GamepadSettings | null): Mapping {
  const axes = Object.fromEntries(
    CONTROLS.map((control): [Control, AxisChoice] => {
      const set = settings?.[control];
      return [control, set == null ? (MODE_2[control] ?? NO_AXIS) : { axis: set.axis ?? null, reverse: set.reverse === true }];
    }),
  ) as Record<Control, AxisChoice>;
  return {
    axes,
    deadZone: settings?.dead_zone ?? 0.05,
    expo: settings?.expo ?? 0,
    gimbalRate_deg_s: settings?.gimbal_rate_deg_s ?? 30,
    buttons: settings?.buttons ?? [{ button: 1, action: 'hold' }],
  };
}

/** The stick that a preset's axes and reversals are; null: a person's own. */
export function presetOf(mapping: Mapping): string | null {
  const isEqual = (control: Control, choice: AxisChoice): boolean =>
    mapping.axes[control].axis === choice.axis && mapping.axes[control].reverse === choice.reverse;
  return PRESETS.find(({ axes }) => FLIGHT_CONTROLS.every((control) => isEqual(control, axes[control] ?? NO_AXIS)))?.name ?? null;
}

/** The sticks for which this gamepad has no axis. */
export function missingControls(mapping: Mapping, pad: PadSnapshot): Control[] {
  return FLIGHT_CONTROLS.filter((control) => {
    const { axis: number } = mapping.axes[control];
    return number === null || number >= pad.axes.length;
  });
}

/** Deflection of one stick, −1 to 1; 0 without an axis. */
export function deflection(mapping: Mapping, control: Control, pad: PadSnapshot): number {
  const { axis: number, reverse } = mapping.axes[control];
  const raw = number === null ? 0 : (pad.axes[number] ?? 0);
  return shapeAxis(reverse ? 0 - raw : raw, mapping) + 0;
}

/** The stick positions of one frame: pitch, roll, yaw −1000 to 1000, throttle 0 to 1000 with 500 in the middle. */
export function stickFrame(mapping: Mapping, pad: PadSnapshot): { type: 'sticks'; pitch: number; roll: number; throttle: number; yaw: number } {
  const full = (control: Control): number => Math.round(1000 * deflection(mapping, control, pad)) + 0;
  return { type: 'sticks', pitch: full('pitch'), roll: full('roll'), throttle: Math.round(500 + 500 * deflection(mapping, 'throttle', pad)), yaw: full('yaw') };
}

/** Rates of the gimbal, up and right positive [deg/s], in whole degrees so that a trembling stick sends nothing new. */
export function gimbalRates(mapping: Mapping, pad: PadSnapshot): { pitch: number; yaw: number } {
  const rate = (control: Control): number => Math.round(mapping.gimbalRate_deg_s * deflection(mapping, control, pad)) + 0;
  return { pitch: rate('gimbal_pitch'), yaw: rate('gimbal_yaw') };
}

/** The actions whose button was pressed since `before`. */
export function pressedActions(mapping: Mapping, before: readonly boolean[], pad: PadSnapshot): ButtonAction[] {
  return mapping.buttons.filter(({ button }) => pad.pressed[button] === true && before[button] === false).map(({ action }) => action);
}
