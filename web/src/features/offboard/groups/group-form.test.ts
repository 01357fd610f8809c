import { describe, expect, it } from 'vitest';
import type { VehicleFacts } from '../../../vehicle/facts';
import { displayText } from '../setpoints/offboard-info';
import { formText, NEW_DRAFT, fieldErrors, setpointFor, setpointsFor, startBody, startTexts, motionText, type Draft } from './group-form';
import { reading, vehicle } from './vehicle.fixture';

const PAIR: Draft = { ...NEW_DRAFT, members: ['1', '2'] };
const MOVE: Draft = { ...PAIR, axes: { ...PAIR.axes, move: ['5', '-2,5', '1'] } };
const VELOCITY: Draft = { ...PAIR, motion: 'velocity', axes: { ...PAIR.axes, velocity: ['1', '0', '−0.5'] } };

describe('the group form', () => {
  it('adds an offset to each vehicle’s position, negates up for NED, and keeps the heading', () => {
    expect(setpointFor(vehicle('1', [10, 20, -8]), MOVE)).toEqual({ type: 'position', position_ned_m: [15, 17.5, -9], yaw_ned_rad: 1 });
    expect(setpointFor(vehicle('2', [0, 0, -6]), MOVE)).toMatchObject({ position_ned_m: [5, -2.5, -7] });
    expect(setpointFor(vehicle('2', null), VELOCITY)).toEqual({ type: 'velocity', velocity_ned_m_s: [1, 0, 0.5], yaw_ned_rad: 1 });
  });

  it('gives no setpoints if a position is not known, and names the vehicles', () => {
    const staleVehicle = { ...vehicle('3', [0, 0, 0]), localPosition: reading({ position_ned_m: [0, 0, 0] }, true) } as unknown as VehicleFacts;
    expect(setpointsFor([vehicle('1', [0, 0, 0]), vehicle('2', null), staleVehicle], MOVE)).toEqual({
      ok: false,
      detail: expect.stringMatching(/^Quad 2 and Quad 3 report no local position/) as string,
    });
  });

  it('builds the API’s request with a start time by the server’s clock', () => {
    const result = setpointsFor([vehicle('1', [0, 0, 0]), vehicle('2', [1, 0, 0])], MOVE);
    if (!result.ok) throw new Error(result.detail);
    const body = startBody(result.setpoints, { ...MOVE, separation_m: '2,5', othersContinue: true }, 1000);
    expect(body).toMatchObject({
      minimum_separation_m: 2.5,
      valid_for_s: 10,
      on_expiry: { action: 'hold', hold_for_s: 5 },
      others_go_on: true,
      members: [{ vehicle: '1' }, { vehicle: '2' }],
    });
    expect(body).not.toHaveProperty('start_at_unix_s');
    expect(startBody(result.setpoints, { ...MOVE, startIn_s: '20' }, 1000)).toMatchObject({ start_at_unix_s: 1020 });
  });

  it('reports each invalid field, for a flying group only those that can change', () => {
    expect(fieldErrors(MOVE, false)).toEqual({});
    const invalidDraft: Draft = {
      ...MOVE,
      members: ['1'],
      axes: { ...MOVE.axes, move: ['far', '0', ''] },
      separation_m: '0',
      startIn_s: '1',
      valid_s: { move: '601', velocity: '5' },
    };
    expect(Object.keys(fieldErrors(invalidDraft, false)).sort()).toEqual(['axis0', 'axis2', 'members', 'separation', 'start', 'valid']);
    expect(fieldErrors(invalidDraft, false)['start']).toBe('Enter a number from 3 to 300 s; leave empty to start immediately.');
    expect(Object.keys(fieldErrors(invalidDraft, true)).sort()).toEqual(['axis0', 'axis2', 'valid']);
    expect(fieldErrors({ ...MOVE, members: Array.from({ length: 11 }, (_, i) => String(i)) }, false)).toHaveProperty('members');
  });

  it('describes vehicles, action and effect in the confirmation', () => {
    expect(motionText(MOVE)).toBe('move 5.0 m north, 2.5 m west, 1.0 m up');
    expect(motionText(VELOCITY)).toBe('fly 1.0 m/s north, 0.5 m/s down');
    expect(motionText(PAIR)).toBe('hold their positions');
    const texts = startTexts(['Quad 1', 'Quad 2'], { ...VELOCITY, startIn_s: '30', othersContinue: true });
    expect(texts.title).toBe('Start group: Quad 1 and Quad 2');
    expect(texts.effect).toBe(
      'All vehicles switch to Offboard at their current positions. In 30 s all fly 1.0 m/s north, 0.5 m/s down together. If two vehicles come closer than 5.0 m, only these two switch to Hold. After 5.0 s all hold position, then switch to Hold. “Hold group” switches all to Hold at any time.',
    );
    expect(startTexts(['Quad 1', 'Quad 2'], MOVE).effect).toContain('This page renews the setpoints while it is visible');
  });
});

describe('the server’s texts', () => {
  it('use the form’s names of fields', () => {
    expect(formText('Place them farther apart, or lower minimum_separation_m.')).toBe('Place them farther apart, or lower “Minimum separation”.');
  });

  it('use the form’s names of setpoint types', () => {
    expect(displayText('A MAVLink link carries no thrust_torque setpoints: it carries attitude, position, position_body, velocity_body.')).toBe(
      'A MAVLink link carries no thrust and torque setpoints: it carries attitude, position, offset, velocity along heading.',
    );
  });
});
