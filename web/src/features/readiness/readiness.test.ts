import { expect, test } from 'vitest';
import { findings, headline, modeRows, readReadiness, type Cause, type Readiness } from './readiness';

const noManualControl: Cause = {
  id: 1,
  name: 'check_modes_manual_control',
  severity: 'warning',
  modes: null,
  component: 'manual control',
  cause: 'No manual control input.',
  remedy: 'Switch the RC transmitter on.',
};
const noSetpoints: Cause = {
  id: 2,
  name: 'check_modes_offboard_signal',
  severity: 'error',
  modes: ['offboard'],
  component: 'system',
  cause: 'No setpoints.',
  remedy: null,
};
const lowBattery: Cause = {
  id: 3,
  name: 'check_battery_low',
  severity: 'warning',
  modes: null,
  component: 'battery',
  cause: 'The battery is low.',
  remedy: null,
};
const mode = (name: string, label: string, arming: Cause[], running: Cause[] = arming): Readiness['modes'][number] => ({
  mode: name,
  label,
  can_arm: arming.length === 0,
  can_run: running.length === 0,
  arming,
  running,
});
const report: Readiness = {
  known: true,
  reported_unix_s: 1,
  words: 'own',
  components_with_errors: ['system'],
  components_with_warnings: [],
  left_out: null,
  offers: [],
  modes: [
    mode('position', 'Position', [noManualControl]),
    mode('offboard', 'Offboard', [noSetpoints]),
    mode('hold', 'Hold', []),
    mode('land', 'Land', [lowBattery], []),
  ],
  findings: [noSetpoints, noManualControl, lowBattery],
};

test('the headline is about arming while the vehicle is disarmed, and about flying while it is armed', () => {
  expect(headline(report, 'hold', false)).toEqual({ text: 'Ready to arm in Hold', detail: '', tone: 'ok' });
  expect(headline(report, 'position', false)).toEqual({ text: 'Cannot arm in Position', detail: 'No manual control input.', tone: 'caution' });
  expect(headline(report, 'land', false).tone).toBe('caution');
  expect(headline(report, 'land', true)).toEqual({ text: 'Land mode is available', detail: '', tone: 'ok' });
  expect(headline(report, 'offboard', true).text).toBe('Offboard mode is not available');
});

test('the headline is "Readiness not known" without a report, and a sample of another format is ignored', () => {
  expect(headline(null, 'hold', false).tone).toBe('neutral');
  expect(headline({ ...report, known: false }, 'hold', false).text).toBe('Readiness not known');
  expect(headline(report, 'px4_9_0', false).text).toBe('Readiness not known');
  expect(readReadiness(undefined)).toBeNull();
  expect(readReadiness({ modes: [] })).toBeNull();
  expect(readReadiness(report)).toBe(report);
});

test('findings that block modes come first and name the modes', () => {
  const notBlocking: Cause = { ...lowBattery, id: 4, cause: 'Wind.' };
  const rows = findings({ ...report, findings: [notBlocking, ...report.findings] });
  expect(rows.map((r) => [r.cause.id, r.blockedModes])).toEqual([
    [2, 'Offboard'],
    [1, 'Position'],
    [3, 'Land'],
    [4, ''],
  ]);
  const sixModes = { ...report, modes: ['a', 'b', 'c', 'd', 'e', 'f'].map((n) => mode(n, n.toUpperCase(), [noSetpoints])) };
  expect(findings(sixModes)[0]?.blockedModes).toBe('every mode');
  sixModes.modes.push(mode('g', 'G', []));
  expect(findings(sixModes)[0]?.blockedModes).toBe('A, B, C, D and 2 more');
});

test('the current mode is first, followed by the possible modes', () => {
  expect(modeRows(report, 'offboard').map((r) => r.mode)).toEqual(['offboard', 'hold', 'land', 'position']);
  expect(modeRows(report, null).at(-1)?.reason).not.toBe('');
  expect(modeRows(report, 'offboard')[0]).toMatchObject({ isCurrent: true, reason: 'No setpoints.' });
});
