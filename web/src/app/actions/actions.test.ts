import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../api/client';
import { confirmationTexts, sendAction, reasonUnavailable, type ActionFacts, type ActionName } from './actions';
import { DEFAULT_VALIDITY } from '../../vehicle/setpoint';
import { ConfirmationSlider, EXPIRES_AFTER_S, DANGER_KEY_HOLD_S, KEY_HOLD_S, KNOB_STEPS } from './confirmation';

const facts: ActionFacts = {
  vehicleId: '1',
  vehicleName: 'Quad 1',
  armed: true,
  inAir: true,
  alt_home_m: 12.44,
  homeDistance_m: 48.2,
  mode: 'offboard',
  streaming: true,
  takeoffAlt_home_m: 10,
  battery_percent: 82,
};

describe('actions', () => {
  it('name vehicle, action and effect with numbers', () => {
    expect(confirmationTexts('rtl', facts)).toMatchObject({ title: 'Return: Quad 1', effect: expect.stringContaining('48.2 m back') });
    expect(confirmationTexts('rtl', facts)?.effect).toContain('Offboard ends.');
    expect(confirmationTexts('takeoff', { ...facts, armed: false })?.effect).toBe('Arms, climbs to 10.0 m above home and holds there. Battery 82 %.');
    expect(confirmationTexts('land', { ...facts, homeDistance_m: null })?.effect).toContain('an unknown distance');
  });
  it('state that the vehicle falls, and send the confirmation text that the server requires', () => {
    expect(confirmationTexts('kill', facts)).toMatchObject({ danger: true, effect: expect.stringContaining('will fall from 12.4 m') });
    expect(confirmationTexts('kill', { ...facts, inAir: false })).toMatchObject({ verb: 'Stop motors', effect: expect.stringContaining('it will fall') });
    const requests: unknown[] = [];
    const api = new ApiClient('p', undefined, (path, init) => {
      requests.push([path, init.body]);
      return Promise.resolve(Response.json({}));
    });
    void sendAction(api, 'kill', { ...facts, vehicleId: '1~2' });
    expect(requests).toEqual([['/api/v1/vehicles/1~2/kill', '{"confirm":"motors stop, vehicle 1~2 falls"}']]);
  });
  it('state whether the vehicle will disarm', () => {
    const effect = (state: Partial<ActionFacts>): string | undefined => confirmationTexts('disarm', { ...facts, ...state })?.effect;
    expect(effect({ inAir: true })).toContain('it will not disarm');
    expect(effect({ inAir: false, onGround: true })).toBe('The vehicle is on the ground. The motors stop.');
    expect(effect({ inAir: false })).toContain('does not report that it is on the ground');
  });
  it('state for each mode what arming does', () => {
    const effectIn = (mode: string, streaming = false): string | undefined =>
      confirmationTexts('arm', { ...facts, armed: false, inAir: false, mode, streaming })?.effect;
    expect(effectIn('hold')).toBe('The motors start on the ground. The vehicle disarms automatically if it does not take off.');
    expect(effectIn('offboard', true)).toContain('it flies to the setpoint as soon as it is armed');
    expect(effectIn('offboard')).toContain('it flies to the setpoints of any other program');
    expect(effectIn('mission')).toContain('it takes off and flies the mission stored on it');
    expect(effectIn('takeoff')).toContain('it takes off as soon as it is armed');
    expect(effectIn('external_1')).toContain('it can take off and fly as soon as it is armed');
  });
  it('state what a new setpoint stream does on the ground', () => {
    const streamStart = { setpoint: { type: 'position' }, validity: DEFAULT_VALIDITY, rate_hz: 50, text: 'Position' };
    for (const start of [null, streamStart]) {
      const effect = (state: Partial<ActionFacts>): string | undefined => confirmationTexts('offboard_start', { ...facts, ...state }, null, start)?.effect;
      expect(effect({ inAir: false, armed: false })).toContain('does not take off now. If it is armed before the setpoint expires, it flies to the setpoint.');
      expect(effect({ inAir: false, armed: true })).toContain('it can take off immediately');
      expect(effect({ inAir: true })).not.toMatch(/take off|armed/);
    }
  });
  it('send Hold without confirmation, and keep Hold, Land now and Stop motors available even if the link is lost', () => {
    expect(confirmationTexts('hold', facts)).toBeNull();
    const linkLost = { ...facts, lost: true, replayed: false };
    for (const action of ['hold', 'kill', 'land_now'] as ActionName[]) expect(reasonUnavailable(action, linkLost)).toBeNull();
    expect(reasonUnavailable('land_now', { ...linkLost, armed: false, inAir: false })).toBe('The vehicle is on the ground.');
    expect(reasonUnavailable('land', linkLost)).not.toBeNull();
    expect(reasonUnavailable('takeoff', { ...facts, lost: false, replayed: false })).toBe('The vehicle is in the air.');
  });

  it('are unavailable for a replay', () => {
    for (const action of ['arm', 'takeoff', 'land', 'rtl', 'hold', 'kill', 'offboard_start'] as ActionName[]) {
      expect(reasonUnavailable(action, { ...facts, lost: false, replayed: true })).toBe('A replayed vehicle accepts no commands.');
    }
  });
});

/** Calls `updatePhase` once per frame, as the page does. */
function tickFrames(confirmation: ConfirmationSlider, from_s: number, to_s: number): ConfirmationSlider['phase'] {
  for (let at_s = from_s; at_s < to_s; at_s += 1 / 50) confirmation.updatePhase(at_s);
  return confirmation.updatePhase(to_s);
}

describe('confirmation', () => {
  it('expires five seconds after the last input', () => {
    const confirmation = new ConfirmationSlider(false, 100);
    expect(confirmation.updatePhase(100 + EXPIRES_AFTER_S - 0.01)).toBe('asking');
    expect(confirmation.updatePhase(100 + EXPIRES_AFTER_S)).toBe('expired');
  });
  it('needs the key held for the whole time, longer for dangerous actions', () => {
    const confirmation = new ConfirmationSlider(false, 0);
    confirmation.pressKey(1);
    confirmation.pressKey(1.5); // the keyboard repeats
    expect(tickFrames(confirmation, 1, 1 + KEY_HOLD_S - 0.01)).toBe('asking');
    expect(tickFrames(confirmation, 1 + KEY_HOLD_S - 0.01, 1 + KEY_HOLD_S)).toBe('confirmed');
    const killConfirmation = new ConfirmationSlider(true, 0);
    killConfirmation.pressKey(0);
    expect(tickFrames(killConfirmation, 0, KEY_HOLD_S)).toBe('asking');
    expect(tickFrames(killConfirmation, KEY_HOLD_S, DANGER_KEY_HOLD_S)).toBe('confirmed');
  });
  it('starts over after an early release, and does not expire while the knob is held', () => {
    const confirmation = new ConfirmationSlider(true, 0);
    confirmation.pressKey(4.5);
    expect(tickFrames(confirmation, 4.5, 5.5)).toBe('asking');
    confirmation.releaseKey(5.6);
    expect(confirmation.progress()).toBe(0);
    expect(confirmation.updatePhase(5.6 + EXPIRES_AFTER_S)).toBe('expired');
    const lateRelease = new ConfirmationSlider(false, 0);
    lateRelease.pressKey(0);
    lateRelease.releaseKey(10);
    expect(lateRelease.updatePhase(10.1)).toBe('asking');
  });
  it('does not count the key as held while the page paints no frames', () => {
    const killConfirmation = new ConfirmationSlider(true, 0);
    killConfirmation.pressKey(0);
    expect(killConfirmation.updatePhase(0.02)).toBe('asking');
    expect(killConfirmation.updatePhase(4)).toBe('asking'); // four seconds without a frame: the key may have been released meanwhile
    killConfirmation.releaseKey(4.01);
    expect(tickFrames(killConfirmation, 4.02, 6)).toBe('asking');
  });
  it('counts each arrow key press as a step, and returns to zero when the knob loses the focus', () => {
    const confirmation = new ConfirmationSlider(true, 0);
    for (let i = 1; i < KNOB_STEPS; i++) confirmation.step(1, i * 0.2);
    expect([confirmation.updatePhase(2), confirmation.progress()]).toEqual(['asking', 0.9]);
    confirmation.step(-1, 2);
    expect(confirmation.progress()).toBe(0.8);
    confirmation.releaseKey(2.1);
    expect(confirmation.progress()).toBe(0);
    for (let i = 0; i < 3; i++) confirmation.step(1, 3);
    confirmation.step(-Infinity, 3);
    expect(confirmation.progress()).toBe(0);
    for (let i = 0; i < KNOB_STEPS; i++) confirmation.step(1, 4);
    expect(confirmation.updatePhase(4)).toBe('confirmed');
    const halfway = new ConfirmationSlider(true, 0);
    halfway.step(1, 1);
    expect(halfway.updatePhase(1 + EXPIRES_AFTER_S)).toBe('expired');
  });
  it('needs the knob at the end of its track', () => {
    const confirmation = new ConfirmationSlider(false, 0);
    confirmation.slide(0.98, 1);
    confirmation.releasePointer(1.1);
    expect(confirmation.updatePhase(1.2)).toBe('asking');
    expect(confirmation.progress()).toBe(0);
    confirmation.slide(1.2, 2);
    expect(confirmation.updatePhase(2)).toBe('confirmed');
    confirmation.cancel();
    expect(confirmation.phase).toBe('confirmed');
  });
});
