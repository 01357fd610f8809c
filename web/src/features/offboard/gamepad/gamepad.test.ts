import { describe, expect, it } from 'vitest';
import { shapeAxis, type PadSnapshot } from '../../../vehicle/gamepad';
import { StickControl, type StickControlInputs } from './stick-control';
import { attitudeSetpoint, CENTRED_STICKS, SCALES, STICK_CURVE, STOP_SETPOINT, sticksOf, velocitySetpoint, type Scale } from './sticks';

const SCALE: Scale = { speed_m_s: 4, climb_m_s: 2, turn_deg_s: 90, tilt_deg: 20 };
const READABLE_INPUTS: StickControlInputs = { visible: true, focused: true, yaw_ned_rad: 1, hoverThrust: 0.5 };
const pad = (axes: number[], held: boolean): PadSnapshot => ({ index: 0, id: 'pad', axes, pressed: [false, false, false, false, false, held] });
const FORWARD = [0, 0, 0, -1];

describe('sticks', () => {
  it('command zero within the dead zone, and increase from zero at the edge of the dead zone', () => {
    expect(shapeAxis(0.1, STICK_CURVE)).toBe(0);
    expect(shapeAxis(-0.09, STICK_CURVE)).toBe(0);
    expect(shapeAxis(0.101, STICK_CURVE)).toBeLessThan(0.01);
    expect(shapeAxis(1, STICK_CURVE)).toBe(1);
    expect(shapeAxis(-1.7, STICK_CURVE)).toBe(-1);
    expect(shapeAxis(Number.NaN, STICK_CURVE)).toBe(0);
  });

  it('are less sensitive near the middle with expo, and monotonic', () => {
    expect(shapeAxis(0.5, { deadZone: 0, expo: 1 })).toBeCloseTo(0.125);
    expect(shapeAxis(0.5, { deadZone: 0, expo: 0 })).toBe(0.5);
    const values = Array.from({ length: 101 }, (_, i) => shapeAxis(i / 100, STICK_CURVE));
    expect(values.every((v, i) => i === 0 || v >= (values[i - 1] ?? 0))).toBe(true);
  });

  it('give positive values for up, although a gamepad reports down as positive', () => {
    expect(sticksOf([0.5, -1, 1, -1], { deadZone: 0, expo: 0 })).toEqual({ forward: 1, right: 1, up: 1, turn: 0.5 });
    expect(sticksOf([], STICK_CURVE)).toEqual(CENTRED_STICKS);
  });

  it('command a velocity in the chosen frame, limited to full speed if deflected diagonally', () => {
    expect(velocitySetpoint({ forward: 1, right: 0, up: 0.5, turn: -1 }, 'heading', SCALE)).toEqual({
      type: 'velocity_body',
      velocity_frd_m_s: [4, 0, -1],
      yaw_rate_ned_rad_s: -Math.PI / 2,
    });
    const diagonal = velocitySetpoint({ forward: 1, right: 1, up: 0, turn: 0 }, 'north', SCALE);
    expect(Math.hypot(...(diagonal.velocity_ned_m_s ?? []))).toBeCloseTo(4);
    expect(diagonal.type).toBe('velocity');
  });

  it('command an attitude in Attitude mode: nose down for forward, hover thrust in the middle', () => {
    const setpoint = attitudeSetpoint({ forward: 1, right: 0, up: 0, turn: 0 }, 1, 0.6, SCALE);
    expect(setpoint.pitch_rad).toBeCloseTo(-20 * (Math.PI / 180));
    expect(setpoint.thrust).toBe(0.6);
    expect(attitudeSetpoint({ ...CENTRED_STICKS, up: 1 }, 1, 0.6, SCALE).thrust).toBe(1);
    expect(attitudeSetpoint({ ...CENTRED_STICKS, up: -1 }, 1, 0.6, SCALE).thrust).toBe(0);
  });

  it('command 0, not -0, in the middle', () => {
    expect(Object.is(velocitySetpoint(CENTRED_STICKS, 'heading', SCALES[0]?.scale ?? SCALE).velocity_frd_m_s?.[2], 0)).toBe(true);
  });
});

describe('the deadman button', () => {
  function flyingControl(mode: 'heading' | 'attitude' = 'heading'): StickControl {
    const stickControl = new StickControl(SCALE, 5);
    stickControl.mode = mode;
    stickControl.engage();
    stickControl.update(pad(FORWARD, false), READABLE_INPUTS, 0);
    expect(stickControl.update(pad(FORWARD, true), READABLE_INPUTS, 0.04).phase).toBe('flying');
    return stickControl;
  }

  it('must be held, or the sticks command zero velocity', () => {
    const stickControl = new StickControl(SCALE, 5);
    expect(stickControl.update(pad(FORWARD, true), READABLE_INPUTS, 0).setpoint).toBeNull();
    stickControl.engage();
    expect(stickControl.update(pad(FORWARD, false), READABLE_INPUTS, 0)).toMatchObject({ phase: 'ready', setpoint: STOP_SETPOINT });
    expect(stickControl.update(pad(FORWARD, true), READABLE_INPUTS, 0.04).setpoint).toMatchObject({ velocity_frd_m_s: [4, 0, 0] });
  });

  it('has no effect if it was already held, until it is released once', () => {
    const stickControl = new StickControl(SCALE, 5);
    stickControl.engage();
    expect(stickControl.update(pad(FORWARD, true), READABLE_INPUTS, 0)).toMatchObject({ phase: 'release', setpoint: STOP_SETPOINT });
    stickControl.update(pad(FORWARD, false), READABLE_INPUTS, 0.04);
    expect(stickControl.update(pad(FORWARD, true), READABLE_INPUTS, 0.08).phase).toBe('flying');
  });

  it.each(['heading', 'attitude'] as const)('stops the vehicle on release (%s)', (mode) => {
    expect(flyingControl(mode).update(pad(FORWARD, false), READABLE_INPUTS, 0.08)).toMatchObject({ phase: 'ready', setpoint: STOP_SETPOINT, endReason: null });
  });

  it.each([
    ['unplugged', null, READABLE_INPUTS],
    ['tab hidden', pad(FORWARD, true), { ...READABLE_INPUTS, visible: false }],
    ['window without focus', pad(FORWARD, true), { ...READABLE_INPUTS, focused: false }],
  ])('does not keep the vehicle flying (%s): the vehicle stops, and stick control ends with a reason', (_, snapshot, inputs) => {
    const stickControl = flyingControl();
    const step = stickControl.update(snapshot, inputs, 0.08);
    expect(step).toMatchObject({ phase: 'off', setpoint: STOP_SETPOINT });
    expect(step.endReason).toMatch(/\.$/);
    // Readable again with the button still held: the sticks command nothing until a person starts stick control again.
    expect(stickControl.update(pad(FORWARD, true), READABLE_INPUTS, 0.12).setpoint).toBeNull();
  });

  it('lets the stick turn the yaw setpoint from the vehicle’s heading, without a jump after a pause', () => {
    const stickControl = flyingControl('attitude');
    const turnedSetpoint = stickControl.update(pad([1, 0, 0, 0], true), READABLE_INPUTS, 0.08).setpoint;
    expect(turnedSetpoint).toMatchObject({ type: 'attitude' });
    expect((turnedSetpoint as { yaw_ned_rad: number }).yaw_ned_rad).toBeCloseTo(1 + (Math.PI / 2) * 0.04);
    const afterPause = stickControl.update(pad([1, 0, 0, 0], true), READABLE_INPUTS, 60).setpoint as { yaw_ned_rad: number };
    expect(afterPause.yaw_ned_rad).toBeCloseTo(1 + (Math.PI / 2) * 0.14);
    expect(stickControl.update(pad(FORWARD, true), { ...READABLE_INPUTS, yaw_ned_rad: null }, 60.04)).toMatchObject({ phase: 'off', setpoint: STOP_SETPOINT });
  });

  it('sends one stop setpoint when a person ends stick control', () => {
    const stickControl = flyingControl();
    expect(stickControl.disengage()).toEqual(STOP_SETPOINT);
    expect(stickControl.disengage()).toBeNull();
  });
});
