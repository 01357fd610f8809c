/**
 * Converts a gamepad's state to setpoints, 25 times a second. The sticks move the vehicle only while the pilot holds the
 * deadman button; otherwise the setpoint is zero velocity. Stick control ends when the page cannot read the sticks (gamepad
 * unplugged, tab hidden, window without focus), or when attitude mode has no heading. Callers pass the time.
 */

import {
  attitudeSetpoint,
  STICK_CURVE,
  STOP_SETPOINT,
  sticksOf,
  velocitySetpoint,
  type PadMode,
  type PadSetpoint,
  type Scale,
  type Sticks,
  CENTRED_STICKS,
} from './sticks';
import { reasonUnreadable, type PadSnapshot, type PageState } from '../../../vehicle/gamepad';

export const RATE_HZ = 25;
/** Longest time step of the yaw's integration, so that the yaw does not jump after a pause [s]. */
const MAX_STEP_S = 0.1;

/** Inputs besides the gamepad. */
export interface StickControlInputs extends PageState {
  /** The vehicle's current yaw; null: not known. */
  yaw_ned_rad: number | null;
  hoverThrust: number;
}

/**
 * `off`: no setpoints; `release`: the deadman button was held from the start and has no effect until the pilot releases it;
 * `ready`: the button is released, the vehicle brakes and hovers; `flying`: the sticks control the vehicle.
 */
export type StickPhase = 'off' | 'release' | 'ready' | 'flying';

/** The setpoint and the state after one reading of the gamepad. */
export interface StickOutput {
  phase: StickPhase;
  /** The setpoint to send now; null for none. */
  setpoint: PadSetpoint | null;
  /** Why stick control ended; null while it continues. */
  endReason: string | null;
  sticks: Sticks;
  /** Whether the deadman button is held. */
  isDeadmanHeld: boolean;
}

export class StickControl {
  phase: StickPhase = 'off';
  mode: PadMode = 'heading';
  private yaw_ned_rad: number | null = null;
  private lastStep_s: number | null = null;

  constructor(
    public scale: Scale,
    public deadmanButton: number,
  ) {}

  engage(): void {
    this.phase = 'release';
    this.lastStep_s = null;
  }

  /** The pilot ends stick control. @returns one stop setpoint to send; null if stick control had ended already. */
  disengage(): PadSetpoint | null {
    const previousPhase = this.phase;
    this.phase = 'off';
    return previousPhase === 'off' ? null : STOP_SETPOINT;
  }

  update(pad: PadSnapshot | null, inputs: StickControlInputs, now_s: number): StickOutput {
    const sticks = pad === null ? CENTRED_STICKS : sticksOf(pad.axes, STICK_CURVE);
    const isDeadmanHeld = pad?.pressed[this.deadmanButton] === true;
    const output = (setpoint: PadSetpoint | null, endReason: string | null = null): StickOutput => ({
      phase: this.phase,
      setpoint,
      endReason,
      sticks,
      isDeadmanHeld,
    });
    if (this.phase === 'off') return output(null);
    const endReason =
      reasonUnreadable(pad, inputs) ?? (this.mode === 'attitude' && inputs.yaw_ned_rad === null ? 'The vehicle no longer reports its heading.' : null);
    if (endReason !== null) {
      this.phase = 'off';
      return output(STOP_SETPOINT, endReason);
    }
    if (this.phase === 'release') {
      if (!isDeadmanHeld) this.phase = 'ready';
      return output(STOP_SETPOINT);
    }
    if (!isDeadmanHeld) {
      this.phase = 'ready';
      this.lastStep_s = null;
      return output(STOP_SETPOINT);
    }
    const dt_s = this.phase === 'flying' && this.lastStep_s !== null ? Math.min(MAX_STEP_S, now_s - this.lastStep_s) : 0;
    if (this.phase !== 'flying') this.yaw_ned_rad = inputs.yaw_ned_rad;
    this.phase = 'flying';
    this.lastStep_s = now_s;
    if (this.mode !== 'attitude') return output(velocitySetpoint(sticks, this.mode, this.scale));
    this.yaw_ned_rad = wrapPi((this.yaw_ned_rad ?? inputs.yaw_ned_rad ?? 0) + sticks.turn * this.scale.turn_deg_s * (Math.PI / 180) * dt_s);
    return output(attitudeSetpoint(sticks, this.yaw_ned_rad, inputs.hoverThrust, this.scale));
  }
}

function wrapPi(angle_rad: number): number {
  const fullTurn = 2 * Math.PI;
  return ((((angle_rad + Math.PI) % fullTurn) + fullTurn) % fullTurn) - Math.PI;
}
