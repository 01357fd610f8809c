import { describe, expect, it } from 'vitest';
import type { VehicleFacts } from '../../vehicle/facts';
import { batchPlan, batchTexts, BATCH_ACTIONS, batchRefusal, type BatchVehicle } from './batch';

function vehicle(id: string, more: object = {}, missionCount: number | null = 4): BatchVehicle {
  const { mode = 'hold', armed = false, ...facts } = more as { mode?: string; armed?: boolean };
  const status = { value: { mode, armed, landed_state: 'on_ground' } };
  const control = { holder: null, holder_key: null, requests: [] };
  return { facts: { id, name: `Quad ${id}`, inAir: false, lost: false, replayed: false, status, control, ...facts } as unknown as VehicleFacts, missionCount };
}
const anna = { control: { holder: 'Anna', holder_key: 'anna', requests: [] } };

describe('one command to several vehicles', () => {
  it('names each vehicle that gets it, and each that does not with the reason', () => {
    const plan = batchPlan('takeoff', [vehicle('1'), vehicle('2', { inAir: true, armed: true }), vehicle('3', anna), vehicle('4', { lost: true })], 'me');
    expect(plan.ready.map(({ facts }) => facts.id)).toEqual(['1']);
    const texts = batchTexts('takeoff', plan, 12);
    expect(texts.title).toBe('Take off: Quad 1');
    expect(texts.effect).toBe(
      'The vehicle arms, climbs to 12.0 m above home and holds there. Left out: Quad 2: The vehicle is in the air. Quad 3: Anna has control of this vehicle. Quad 4: No connection to the vehicle.',
    );
  });

  it('starts no mission on a vehicle that has none or flies it', () => {
    expect(batchRefusal('mission', vehicle('1', {}, 0), 'me')).toBe('It has no mission.');
    expect(batchRefusal('mission', vehicle('1', { mode: 'mission', armed: true, inAir: true }), 'me')).toBe('It is flying its mission already.');
    expect(batchRefusal('mission', vehicle('1', { armed: true, inAir: true }), 'me')).toBeNull();
  });

  it('is never for a replay, and needs control', () => {
    for (const action of BATCH_ACTIONS) {
      expect(batchRefusal(action, vehicle('1', { replayed: true }), 'me'), action).not.toBeNull();
      expect(batchRefusal(action, vehicle('1', { ...anna, inAir: action === 'land' || action === 'rtl' }), 'me'), action).toContain('Anna');
    }
    expect(batchRefusal('land', vehicle('1'), 'me')).toBe('The vehicle is on the ground.');
    expect(batchRefusal('arm', vehicle('1', { armed: true }), 'me')).toBe('It is armed already.');
  });
});
