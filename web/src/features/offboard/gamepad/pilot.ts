/**
 * Converts a gamepad's state to setpoints, 25 times a second. The sticks move the vehicle only while the deadman button is
 * held; the vehicle stops as soon as the button is released. Control by the sticks ends when the page cannot read them (gamepad
 * unplugged, tab hidden, window without focus). Pure: callers pass the time.
 */

import { attitudeSetpoint, STICK_CURVE, STOP, sticksOf, velocitySetpoint, type PadMode, type PadSetpoint, type Scale, type Sticks, CENTRED } from './sticks';

export const RATE_HZ = 25;
/** Longest time step of the yaw's integration, so that the yaw does not jump after a pause [s]. */
const MAX_STEP_S = 0.1;

/** State of a gamepad at one moment. */
export interface PadSnapshot {
  index: number;
  id: string;
  axes: readonly number[];
  pressed: readonly boolean[];
}

/** Inputs besides the gamepad. The page can read the sticks only while it is visible and has the focus. */
export interface PilotInputs {
  visible: boolean;
  focused: boolean;
  /** The vehicle's present yaw; null is unknown. */
  yaw_ned_rad: number | null;
  hoverThrust: number;
}

/**
 * `release`: the pilot must release the deadman button once before it has an effect; `ready`: the vehicle stops and
 * hovers; `flying`: the sticks control the vehicle.
 */
export type PilotPhase = 'off' | 'release' | 'ready' | 'flying';

export interface Step {
  phase: PilotPhase;
  /** The setpoint to send now; null for none. */
  setpoint: PadSetpoint | null;
  /** Why control by the sticks ended; null while it continues. */
  endReason: string | null;
  sticks: Sticks;
  /** Whether the deadman button is held. */
  held: boolean;
}

export class Pilot {
  phase: PilotPhase = 'off';
  mode: PadMode = 'heading';
  private yaw_ned_rad: number | null = null;
  private lastStep_s: number | null = null;

  constructor(
    public scale: Scale,
    public deadman: number,
  ) {}

  engage(): void {
    this.phase = 'release';
    this.lastStep_s = null;
  }

  /** The pilot ends control by the sticks. @returns one stop setpoint to send; null if control by the sticks had ended already. */
  disengage(): PadSetpoint | null {
    const previous = this.phase;
    this.phase = 'off';
    return previous === 'off' ? null : STOP;
  }

  step(pad: PadSnapshot | null, inputs: PilotInputs, now_s: number): Step {
    const sticks = pad === null ? CENTRED : sticksOf(pad.axes, STICK_CURVE);
    const held = pad?.pressed[this.deadman] === true;
    const result = (setpoint: PadSetpoint | null, endReason: string | null = null): Step => ({ phase: this.phase, setpoint, endReason, sticks, held });
    if (this.phase === 'off') return result(null);
    const endReason =
      reasonUnreadable(pad, inputs) ?? (this.mode === 'attitude' && inputs.yaw_ned_rad === null ? 'The vehicle no longer reports its heading.' : null);
    if (endReason !== null) {
      this.phase = 'off';
      return result(STOP, endReason);
    }
    if (this.phase === 'release') {
      if (!held) this.phase = 'ready';
      return result(STOP);
    }
    if (!held) {
      this.phase = 'ready';
      this.lastStep_s = null;
      return result(STOP);
    }
    const dt_s = this.phase === 'flying' && this.lastStep_s !== null ? Math.min(MAX_STEP_S, now_s - this.lastStep_s) : 0;
    if (this.phase !== 'flying') this.yaw_ned_rad = inputs.yaw_ned_rad;
    this.phase = 'flying';
    this.lastStep_s = now_s;
    if (this.mode !== 'attitude') return result(velocitySetpoint(sticks, this.mode, this.scale));
    this.yaw_ned_rad = wrapPi((this.yaw_ned_rad ?? inputs.yaw_ned_rad ?? 0) + sticks.turn * this.scale.turn_deg_s * (Math.PI / 180) * dt_s);
    return result(attitudeSetpoint(sticks, this.yaw_ned_rad, inputs.hoverThrust, this.scale));
  }
}

function reasonUnreadable(pad: PadSnapshot | null, inputs: PilotInputs): string | null {
  if (pad === null) return 'The gamepad was disconnected.';
  if (!inputs.visible) return 'The page was hidden.';
  return inputs.focused ? null : 'The window lost focus.';
}

function wrapPi(angle_rad: number): number {
  const fullTurn = 2 * Math.PI;
  return ((((angle_rad + Math.PI) % fullTurn) + fullTurn) % fullTurn) - Math.PI;
}
