import { describe, expect, it } from 'vitest';
import { BOUNDS } from '../api/bounds';
import { inPercent, limitProblem, parseNumber, quantityOf } from './fields';

describe('a number field', () => {
  it('has unit, step and scale by its name, and the API’s bounds in the shown unit', () => {
    expect(quantityOf('speed_m_s', BOUNDS.step_fly.speed_m_s)).toEqual({ unit: 'speed', step: 0.5, scale: 1, above: 0, max: 100 });
    expect(quantityOf('interval_ms')).toEqual({ unit: 'ms', step: 10, scale: 1 });
    expect(quantityOf('times')).toEqual({ unit: '', step: 1, scale: 1 });
    expect(quantityOf('roll_rad', { min: -1.5, max: 1.5 })).toMatchObject({ unit: '°', min: -85.94, max: 85.94 });
    expect(quantityOf('yaw_ned_rad', { min: -1000, max: 1000 })).toMatchObject({ min: -360, max: 360 });
    expect(inPercent({ min: 0.3, max: 0.95 })).toEqual({ min: 30, max: 95 });
  });

  it('says which numbers it accepts', () => {
    expect([limitProblem(5, { min: 1, max: 10 }), limitProblem(0.1, { above: 0 })]).toEqual([null, null]);
    expect(limitProblem(0, { above: 0, max: 100 }, 'm')).toBe('Enter a number above 0, at most 100 m.');
    expect(limitProblem(0, { min: 1, max: 10 })).toBe('Enter a number from 1 to 10.');
    expect(limitProblem(0, { min: 1 }, 's')).toBe('Enter a number of at least 1 s.');
    expect(limitProblem(11, { max: 10 })).toBe('Enter a number of at most 10.');
    expect(parseNumber('2e9')).toEqual({ ok: false, problem: 'Enter a number from -1000000000 to 1000000000.' });
    expect(parseNumber('0', { above: 0 }).ok).toBe(false);
  });
});
