/**
 * Turns a gamepad's state into setpoints, 25 times a second. The sticks count only while the deadman button is held;
 * the vehicle stops as soon as the button is released. Control by the sticks ends when they cannot be read (gamepad
 * unplugged, tab hidden, window without focus). Pure: callers pass the time.
 */

import { attitudeSetpoint, STICK_CURVE, STOP, sticksOf, velocitySetpoint, type PadMode, type PadSetpoint, type Scale, type Sticks, CENTRED } from './sticks';

export const RATE_HZ = 25;
/** Longest step for integrating the yaw, so that it does not jump after a pause [s]. */
const MAX_STEP_S = 0.1;

/** State of a gamepad at one moment. */
export interface PadSnapshot {
  index: number;
  id: string;
  axes: readonly number[];
  pressed: readonly boolean[];
}

/** What the setpoints depend on besides the gamepad: the page must be visible and have the focus, or the sticks cannot be read. */
export interface PilotInputs {
  visible: boolean;
  focused: boolean;
  /** The vehicle's present yaw; null is unknown. */
  yaw_ned_rad: number | null;
  hoverThrust: number;
}

/**
 * `release`: the button must be released once before it counts; `ready`: stopped; `flying`: the sticks control the
 * vehicle.
 */
export type PilotPhase = 'off' | 'release' | 'ready' | 'flying';

export interface Step {
  phase: PilotPhase;
  /** The setpoint to send now; null for none. */
  setpoint: PadSetpoint | null;
  /** Why control by the sticks ended; null while it continues. */
  ended: string | null;
  sticks: Sticks;
  held: boolean;
}

export class Pilot {
  phase: PilotPhase = 'off';
  mode: PadMode = 'heading';
  private yaw_ned_rad: number | null = null;
  private last_s: number | null = null;

  constructor(
    public scale: Scale,
    public deadman: number,
  ) {}

  engage(): void {
    this.phase = 'release';
    this.last_s = null;
  }

  /** The user ends control by the sticks. @returns one stop setpoint to send; null if it had ended already. */
  disengage(): PadSetpoint | null {
    const was = this.phase;
    this.phase = 'off';
    return was === 'off' ? null : STOP;
  }

  step(pad: PadSnapshot | null, inputs: PilotInputs, now_s: number): Step {
    const sticks = pad === null ? CENTRED : sticksOf(pad.axes, STICK_CURVE);
    const held = pad?.pressed[this.deadman] === true;
    const result = (setpoint: PadSetpoint | null, ended: string | null = null): Step => ({ phase: this.phase, setpoint: setpoint, ended, sticks, held });
    if (this.phase === 'off') return result(null);
    const why = whyUnreadable(pad, inputs) ?? (this.mode === 'attitude' && inputs.yaw_ned_rad === null ? 'The vehicle no longer reports its heading.' : null);
    if (why !== null) {
      this.phase = 'off';
      return result(STOP, why);
    }
    if (this.phase === 'release') {
      if (!held) this.phase = 'ready';
      return result(STOP);
    }
    if (!held) {
      this.phase = 'ready';
      this.last_s = null;
      return result(STOP);
    }
    const dt_s = this.phase === 'flying' && this.last_s !== null ? Math.min(MAX_STEP_S, now_s - this.last_s) : 0;
    if (this.phase !== 'flying') this.yaw_ned_rad = inputs.yaw_ned_rad;
    this.phase = 'flying';
    this.last_s = now_s;
    if (this.mode !== 'attitude') return result(velocitySetpoint(sticks, this.mode, this.scale));
    this.yaw_ned_rad = wrapPi((this.yaw_ned_rad ?? inputs.yaw_ned_rad ?? 0) + sticks.turn * this.scale.turn_deg_s * (Math.PI / 180) * dt_s);
    return result(attitudeSetpoint(sticks, this.yaw_ned_rad, inputs.hoverThrust, this.scale));
  }
}

function whyUnreadable(pad: PadSnapshot | null, inputs: PilotInputs): string | null {
  if (pad === null) return 'The gamepad was disconnected.';
  if (!inputs.visible) return 'The page was hidden.';
  return inputs.focused ? null : 'The window lost focus.';
}

function wrapPi(angle_rad: number): number {
  const turn = 2 * Math.PI;
  return ((((angle_rad + Math.PI) % turn) + turn) % turn) - Math.PI;
}
