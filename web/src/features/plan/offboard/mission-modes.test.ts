import { describe, expect, it } from 'vitest';
import { canRemove, canSelect, parseDeferral, deferralProblem, modeName, modeText, registerProblem, selectTexts, type MissionMode } from './mission-modes';
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
const modeWith = (fields: Partial<MissionMode>): MissionMode => ({ ...MODE, ...fields });
const IN_AIR_MISSION = { steps: [{ step: 'fly' }] } as unknown as Mission;
const ERROR = { code: 'fence_crossed', severity: 'error', text: 'The path leaves the geofence.' } as unknown as Finding;

describe('the name of a mode', () => {
  it('is the name of the mission in at most 24 ASCII characters', () => {
    expect(modeName('Tower survey')).toBe('Tower survey');
    expect(modeName(' Überflug Süd → 2 ')).toBe('Uberflug Sud  2');
    expect(modeName('A mission with a very long name')).toBe('A mission with a very lo');
    expect(modeName('日本')).toBe('');
  });

  it('is refused with a reason if it is not ASCII, too long or already registered', () => {
    expect(registerProblem('Line 2', IN_AIR_MISSION, [], [MODE])).toBeNull();
    expect(registerProblem('', IN_AIR_MISSION, [], [])).toContain('1 to 24');
    expect(registerProblem('Süd', IN_AIR_MISSION, [], [])).toContain('ASCII');
    expect(registerProblem('Short line', IN_AIR_MISSION, [], [MODE])).toContain('already registered');
    expect(registerProblem('Short line', IN_AIR_MISSION, [], [modeWith({ state: 'lost', mode: null })])).toBeNull();
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
    expect(parseDeferral(text)).toBe(deferral_s);
    expect(deferralProblem(text) === null).toBe(deferral_s !== null);
  });

  it('has an error text with its range', () => {
    expect(deferralProblem('500')).toBe('Enter a whole number from 0 (never) to 120.');
  });
});

describe('registering', () => {
  it('needs a checked mission without errors', () => {
    expect(registerProblem('Line 2', IN_AIR_MISSION, null, [])).toContain('not been checked');
    expect(registerProblem('Line 2', IN_AIR_MISSION, [ERROR], [])).toBe('An error to fix or accept below: The path leaves the geofence.');
    expect(registerProblem('Line 2', IN_AIR_MISSION, [ERROR, ERROR], [])).toBe('2 errors to fix or accept below. The first one: The path leaves the geofence.');
  });

  it('accepts missions that begin with a take-off, and missions that begin in the air', () => {
    const takeoffMission = { steps: [{ step: 'take_off' }] } as unknown as Mission;
    const takeoffMissing = { ...ERROR, code: 'takeoff_missing' };
    expect(registerProblem('Line 2', takeoffMission, [], [])).toBeNull();
    expect(registerProblem('Line 2', takeoffMission, [takeoffMissing], [])).toContain('An error to fix');
    expect(registerProblem('Line 2', IN_AIR_MISSION, [takeoffMissing], [])).toBeNull();
  });
});

describe('a mode', () => {
  it('has a text for each state', () => {
    expect(modeText(MODE, 'hold')).toEqual({ text: 'Registered. The mission starts when this mode is selected in flight.', tone: 'ok' });
    expect(modeText(modeWith({ takes_off: true }), 'hold').text).toContain(
      'The vehicle takes off and starts the mission when it is armed in this mode on the ground.',
    );
    expect(modeText(MODE, 'external_1')).toEqual({ text: 'Selected', tone: 'target' });
    expect(modeText(modeWith({ defer_failsafes_s: 20, failsafe_deferred: true }), 'external_1')).toEqual({
      text: 'A failsafe has been triggered. PX4 defers it for at most 20 s, or until the vehicle leaves this mode.',
      tone: 'danger',
    });
    expect(modeText(modeWith({ state: 'registering', mode: null }), null).tone).toBe('dim');
    const compilingMode = modeWith({ takes_off: true, ready: false, reason: 'The mission is being compiled.' });
    expect(modeText(compilingMode, 'external_1')).toEqual({ text: 'Registered, but cannot be started now: The mission is being compiled.', tone: 'caution' });
    expect(modeText(modeWith({ state: 'lost', mode: null, reason: 'PX4 restarted' }), null)).toEqual({
      text: 'Not registered: PX4 restarted',
      tone: 'caution',
    });
  });

  it('can be selected if it is registered and not selected already', () => {
    expect(canSelect(MODE, 'hold')).toBe(true);
    expect(canSelect(MODE, 'external_1')).toBe(false);
    expect(canSelect(modeWith({ state: 'lost', mode: null }), 'hold')).toBe(false);
  });

  it('can be removed, except during its registration or while the vehicle flies in it', () => {
    expect(canRemove(MODE, 'hold', true)).toBe(true);
    expect(canRemove(MODE, 'external_1', true)).toBe(false);
    expect(canRemove(MODE, 'external_1', false)).toBe(true);
    expect(canRemove(modeWith({ state: 'lost', mode: null }), null, true)).toBe(true);
    expect(canRemove(modeWith({ state: 'registering', mode: null }), 'hold', false)).toBe(false);
  });

  it('is started after a confirmation that states the failsafe', () => {
    const texts = selectTexts(MODE, 'Quad 1', true);
    expect(texts.title).toBe('Start “Short line” with Quad 1');
    expect(texts.effect).toContain('“Line” (version 3)');
    expect(texts.effect).toContain('(RTL)');
    expect(texts.effect).not.toContain('defers');
    expect(selectTexts(modeWith({ defer_failsafes_s: 20 }), 'Quad 1', true).effect).toContain('defers these failsafes for up to 20 s');
  });

  it('is selected on the ground after a confirmation that states the effect of arming', () => {
    const texts = selectTexts(MODE, 'Quad 1', false);
    expect(texts.title).toBe('Select “Short line” for Quad 1');
    expect(texts.effect).toContain('PX4 does not arm in this mode');
    expect(selectTexts(modeWith({ takes_off: true }), 'Quad 1', false).effect).toContain('as soon as somebody arms it in this mode');
  });

  it('with a take-off can only continue a suspended mission in the air', () => {
    const texts = selectTexts(modeWith({ takes_off: true }), 'Quad 1', true);
    expect(texts.effect).toContain('continues the mission “Line” (version 3) if it was suspended');
  });
});
