import { describe, expect, it } from 'vitest';
import { canRemove, canSelect, deferralOf, deferralProblem, modeName, modeText, registerProblem, selectQuestion, type MissionMode } from './mission-modes';
import type { Finding } from '../document/fixes';
import type { Mission } from './mission';

const MODE: MissionMode = {
  name: 'Short line',
  state: 'registered',
  mode: 'external_1',
  ready: true,
  reason: '',
  mission: 'Line',
  plan_id: 'p1',
  version: 3,
  client: 'Anna',
  defer_failsafes_s: 0,
  failsafe_deferred: false,
  takes_off: false,
};
const as = (more: Partial<MissionMode>): MissionMode => ({ ...MODE, ...more });
const FLIES = { steps: [{ step: 'fly' }] } as unknown as Mission;
const ERROR = { code: 'fence_crossed', severity: 'error', text: 'The path leaves the geofence.' } as unknown as Finding;

describe('the name of a mode', () => {
  it('is the name of the mission as PX4 can show it', () => {
    expect(modeName('Tower survey')).toBe('Tower survey');
    expect(modeName(' Überflug Süd → 2 ')).toBe('Uberflug Sud  2');
    expect(modeName('A mission with a very long name')).toBe('A mission with a very lo');
    expect(modeName('日本')).toBe('');
  });

  it('is refused with a reason if PX4 cannot show it or has it already', () => {
    expect(registerProblem('Line 2', FLIES, [], [MODE])).toBeNull();
    expect(registerProblem('', FLIES, [], [])).toContain('1 to 24');
    expect(registerProblem('Süd', FLIES, [], [])).toContain('ASCII');
    expect(registerProblem('Short line', FLIES, [], [MODE])).toContain('already registered');
    expect(registerProblem('Short line', FLIES, [], [as({ state: 'lost', mode: null })])).toBeNull();
  });
});

describe('the time for deferred failsafes', () => {
  it.each([
    ['0', 0],
    ['', 0],
    [' 20 ', 20],
    ['120', 120],
    ['121', null],
    ['-1', null],
    ['2.5', null],
    ['1e2', null],
    ['soon', null],
  ])('is read from “%s”', (text, deferral_s) => {
    expect(deferralOf(text)).toBe(deferral_s);
    expect(deferralProblem(text) === null).toBe(deferral_s !== null);
  });

  it('states its range if it is not valid', () => {
    expect(deferralProblem('500')).toBe('Enter a whole number from 0 (never) to 120.');
  });
});

describe('registering', () => {
  it('needs a checked mission without errors', () => {
    expect(registerProblem('Line 2', FLIES, null, [])).toContain('not been checked');
    expect(registerProblem('Line 2', FLIES, [ERROR], [])).toBe('An error to fix or accept below: The path leaves the geofence.');
    expect(registerProblem('Line 2', FLIES, [ERROR, ERROR], [])).toContain('2 errors');
  });

  it('accepts missions that begin with a take-off, and missions that begin in the air', () => {
    const climbs = { steps: [{ step: 'take_off' }] } as unknown as Mission;
    const missing = { ...ERROR, code: 'takeoff_missing' };
    expect(registerProblem('Line 2', climbs, [], [])).toBeNull();
    expect(registerProblem('Line 2', climbs, [missing], [])).toContain('An error to fix');
    expect(registerProblem('Line 2', FLIES, [missing], [])).toBeNull();
  });
});

describe('a mode', () => {
  it('has its state as a text', () => {
    expect(modeText(MODE, 'hold')).toEqual({ text: 'ready to be selected: select it in flight; the mission then starts at once', tone: 'ok' });
    expect(modeText(as({ takes_off: true }), 'hold').text).toContain('select it on the ground and arm; the vehicle then takes off by itself');
    expect(modeText(MODE, 'external_1')).toEqual({ text: 'selected', tone: 'target' });
    expect(modeText(as({ defer_failsafes_s: 20, failsafe_deferred: true }), 'external_1')).toEqual({
      text: 'selected. PX4 defers a failsafe for up to 20 s',
      tone: 'caution',
    });
    expect(modeText(as({ state: 'registering', mode: null }), null).tone).toBe('dim');
    const compiling = as({ takes_off: true, ready: false, reason: 'The mission is being compiled.' });
    expect(modeText(compiling, 'external_1')).toEqual({ text: 'PX4 does not arm in this mode now: The mission is being compiled.', tone: 'caution' });
    expect(modeText(as({ state: 'lost', mode: null, reason: 'PX4 restarted' }), null)).toEqual({ text: 'not registered: PX4 restarted', tone: 'caution' });
  });

  it('is selected if it is registered, and not again', () => {
    expect(canSelect(MODE, 'hold')).toBe(true);
    expect(canSelect(MODE, 'external_1')).toBe(false);
    expect(canSelect(as({ state: 'lost', mode: null }), 'hold')).toBe(false);
  });

  it('is removed at any time, except while it flies', () => {
    expect(canRemove(MODE, 'hold', true)).toBe(true);
    expect(canRemove(MODE, 'external_1', true)).toBe(false);
    expect(canRemove(MODE, 'external_1', false)).toBe(true);
    expect(canRemove(as({ state: 'lost', mode: null }), null, true)).toBe(true);
    expect(canRemove(as({ state: 'registering', mode: null }), 'hold', false)).toBe(false);
  });

  it('is started after a question that states the failsafe', () => {
    const asks = selectQuestion(MODE, 'Quad 1', true);
    expect(asks.title).toBe('Start “Short line” with Quad 1');
    expect(asks.effect).toContain('“Line” (version 3)');
    expect(asks.effect).toContain('(RTL)');
    expect(asks.effect).not.toContain('defers');
    expect(selectQuestion(as({ defer_failsafes_s: 20 }), 'Quad 1', true).effect).toContain('defers failsafes for up to 20 s');
  });

  it('is selected on the ground after a question that states what arming does', () => {
    const asks = selectQuestion(MODE, 'Quad 1', false);
    expect(asks.title).toBe('Select “Short line” for Quad 1');
    expect(asks.effect).toContain('PX4 does not arm in this mode');
    expect(selectQuestion(as({ takes_off: true }), 'Quad 1', false).effect).toContain('as soon as somebody arms it in this mode');
  });

  it('with a take-off only continues in the air', () => {
    const asks = selectQuestion(as({ takes_off: true }), 'Quad 1', true);
    expect(asks.effect).toContain('continues the mission “Line” (version 3) if it was suspended');
  });
});
