/** A gamepad's state, and what of it a pilot's sticks are. Pure functions. */

export interface StickCurve {
  /** Dead zone, 0–0.5. */
  deadZone: number;
  /** Expo: 0 is linear, 1 is cubic with low sensitivity near the middle. */
  expo: number;
}

/** State of a gamepad at one moment. */
export interface PadSnapshot {
  index: number;
  id: string;
  axes: readonly number[];
  pressed: readonly boolean[];
}

/** The page can read the sticks only while it is visible and has the focus. */
export interface PageState {
  visible: boolean;
  focused: boolean;
}

/** Applies dead zone and expo to one axis: 0 within the dead zone, ±1 at full deflection, continuous between. NaN gives 0. */
export function shapeAxis(value: number, { deadZone, expo }: StickCurve): number {
  if (!Number.isFinite(value)) return 0;
  const magnitude = Math.min(1, Math.abs(value));
  if (magnitude <= deadZone) return 0;
  const x = (magnitude - deadZone) / (1 - deadZone);
  return Math.sign(value) * (x * (1 - expo) + x ** 3 * expo);
}

/** Why the page cannot read the sticks; null: it can. */
export function reasonUnreadable(pad: PadSnapshot | null, { visible, focused }: PageState): string | null {
  if (pad === null) return 'The gamepad was disconnected.';
  if (!visible) return 'The page was hidden.';
  return focused ? null : 'The window lost focus.';
}

/** The connected gamepads, as the browser reports them. */
export function connectedPads(): PadSnapshot[] {
  return [...(navigator.getGamepads?.() ?? [])]
    .filter((pad): pad is Gamepad => pad !== null && pad.connected)
    .map(({ index, id, axes, buttons }) => ({ index, id, axes: [...axes], pressed: buttons.map((button) => button.pressed) }));
}

export const pageState = (): PageState => ({ visible: document.visibilityState === 'visible', focused: document.hasFocus() });
