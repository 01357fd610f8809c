import { describe, expect, it } from 'vitest';
import { cellText, resultText, sortedRows, type ReviewRow } from '../../../app/param-changes/changes.svelte';
import { outputValues, reversedMask, takenBy, type Output } from './setup.svelte';

const output = (name: string, number: number, axis: Output['axis'] = null): Output => ({
  name,
  label: name,
  function_param: `PWM_${name.replace(' ', '_FUNC')}`,
  function: number,
  function_label: number === 101 ? 'Motor 1' : null,
  axis,
  reverse_param: 'PWM_MAIN_REV',
  reverse_bit: 0,
  reversed: false,
  pwm_us: null,
});
const functions = { roll: 420, pitch: 421, yaw: 422 };
const outputs = [output('MAIN 1', 101), output('MAIN 7', 420, 'roll'), output('MAIN 8', 0)];

describe('the outputs of a gimbal', () => {
  it('move an axis to another output and disable the one before', () => {
    expect(outputValues(outputs, 'roll', 'PWM_MAIN_FUNC8', functions)).toEqual({ PWM_MAIN_FUNC7: 0, PWM_MAIN_FUNC8: 420 });
    expect(outputValues(outputs, 'roll', null, functions)).toEqual({ PWM_MAIN_FUNC7: 0 });
    expect(outputValues(outputs, 'yaw', 'PWM_MAIN_FUNC8', functions)).toEqual({ PWM_MAIN_FUNC8: 422 });
  });
  it('never include that of a motor by a slip', () => {
    expect(outputs.map(takenBy)).toEqual(['Motor 1', null, null]);
    expect(takenBy({ ...output('AUX 1', 900) })).toBe('function 900');
  });
  it('are reversed one by one', () => {
    expect([reversedMask(0, 7, true), reversedMask(129, 7, true), reversedMask(129, 7, false), reversedMask(1, 7, false)]).toEqual([128, 129, 1, 1]);
  });
});

describe('the review of parameters', () => {
  const row = (more: Partial<ReviewRow>): ReviewRow => ({ name: 'A', state: 'change', old: 1, new: 2, ...more }) as ReviewRow;
  it('shows refused rows first', () => {
    const rows = [row({ state: 'same' }), row({}), row({ state: 'refused' })];
    expect(sortedRows(rows).map(({ state }) => state)).toEqual(['refused', 'change', 'same']);
  });
  it('shows a value with its name or unit', () => {
    expect([cellText(-1, 'Disabled', null), cellText(0.30000001192092896, null, 'm'), cellText(null, null, 'm')]).toEqual(['Disabled (−1)', '0.3 m', '–']);
  });
  it('names in its result what was not taken and why the rest was not written', () => {
    const written = (state: 'set' | 'not_taken' | 'not_written') => ({ name: 'A', old: 1, value: 2, now: null, state, problem: null });
    expect(resultText({ rows: [written('set')], stopped: null, waiting: [], undo_count: 1 })).toBe('1 of 1 written.');
    const rows = [written('set'), written('not_taken'), written('not_written')];
    expect(resultText({ rows, stopped: 'Bob has control.', waiting: [], undo_count: 1 })).toBe(
      '1 of 3 written, 1 not taken by the vehicle, 1 not written. Bob has control.',
    );
  });
});
