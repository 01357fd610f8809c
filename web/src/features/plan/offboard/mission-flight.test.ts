import { describe, expect, it } from 'vitest';
import { positionAt } from '../../../vehicle/geo';
import type { DryRunResult } from '../dry-run/dry-run.svelte';
import {
  executorText,
  dryRunIdWithCorridor,
  dryRunIdWithCorridorForRoles,
  corridorText,
  deviationText,
  hasEnded,
  startProblem,
  commandTexts,
  availableCommands,
  flightProgress,
  startTexts,
  lastFlightText,
  stateLabel,
  type MissionFlight,
} from './mission-flight';
import type { Finding } from '../document/fixes';
import type { Mission } from './mission';

const FLIGHT: MissionFlight = {
  state: 'flying',
  name: 'Tower',
  plan_id: null,
  version: null,
  client: 'Anna',
  role: null,
  others: [],
  started_unix_s: 100,
  place: 'step 2',
  title: 'Approach',
  duration_s: 200,
  remaining_s: 150,
  deviation_m: 0.34,
  outside_corridor_m: null,
  dry_run: null,
  mode: 'offboard',
  executor_in_charge: null,
  question: null,
  reason: null,
  if_stream_stops: 'it lands.',
};
const flightWith = (fields: Partial<MissionFlight>): MissionFlight => ({ ...FLIGHT, ...fields });
const MISSION = {
  name: 'Tower',
  steps: [{ step: 'take_off' }, { step: 'land' }],
  actions: { failure: 'hold', low_battery: 'land', link_loss: 'hold', control_lost: 'hold' },
} as unknown as Mission;

const error = (text: string): Finding => ({
  code: 'fence_crossed',
  severity: 'error',
  text,
  place: { row: null, zone: null, rally_point: null, obstacle: null, step: 'step 2' },
  fix: null,
  limit: null,
});

describe('who commands the vehicle', () => {
  it('is stated during a flight in a flight mode with an executor', () => {
    expect(executorText(FLIGHT)).toBeNull();
    expect(executorText(flightWith({ mode: 'external_1', executor_in_charge: true }))).toContain('The mission commands the vehicle');
    expect(executorText(flightWith({ mode: 'external_1', executor_in_charge: false, state: 'suspended' }))).toContain(
      'the mission no longer commands the vehicle',
    );
    expect(executorText(flightWith({ mode: 'external_1', executor_in_charge: false, state: 'done' }))).toBeNull();
  });
});

describe('the corridor of a dry run', () => {
  const start = { lat_deg: 47.4, lon_deg: 8.5 };
  const dryRunResult = (fields: object) =>
    ({ id: '7', vehicle: '1', monte_carlo: { corridor: {} }, nominal: { origin: start }, ...fields }) as unknown as DryRunResult;

  it('is used only for the same vehicle and start', () => {
    expect(dryRunIdWithCorridor(dryRunResult({}), '1', positionAt(start, { north_m: 3, east_m: 3 }))).toBe('7');
    expect(dryRunIdWithCorridor(dryRunResult({}), '1', positionAt(start, { north_m: 6, east_m: 0 }))).toBeNull();
    expect([
      dryRunIdWithCorridor(dryRunResult({}), '2', start),
      dryRunIdWithCorridor(dryRunResult({ monte_carlo: null }), '1', start),
      dryRunIdWithCorridor(null, '1', start),
    ]).toEqual([null, null, null]);
  });

  it('is used for several vehicles if each has the same role and start', () => {
    const corridor = (east_m: number) => ({ corridor: { position_ned_m: [[0, east_m, 0]] } });
    const group = { monte_carlo: { roles: { lead: corridor(0), left: corridor(20) } } };
    const vehicles = { lead: '1', left: '2' };
    const dryRun = dryRunResult({ vehicle: null, vehicles, group });
    const at = (id: string) => positionAt(start, { north_m: 2, east_m: id === '1' ? 0 : 20 });
    expect(dryRunIdWithCorridorForRoles(dryRun, vehicles, at)).toBe('7');
    expect(dryRunIdWithCorridorForRoles(dryRun, { lead: '2', left: '1' }, at)).toBeNull();
    expect(dryRunIdWithCorridorForRoles(dryRun, vehicles, () => start)).toBeNull();
    expect(dryRunIdWithCorridorForRoles(dryRun, vehicles, () => null)).toBeNull();
    expect([
      dryRunIdWithCorridorForRoles(dryRunResult({ vehicle: null, group: null }), vehicles, at),
      dryRunIdWithCorridorForRoles(null, vehicles, at),
    ]).toEqual([null, null]);
  });

  it('is mentioned while the vehicle is outside it', () => {
    expect(corridorText(flightWith({ outside_corridor_m: 1.26, dry_run: '7' }))).toBe('1.3 m outside the corridor of the dry run');
    expect([corridorText(flightWith({ outside_corridor_m: 0 })), corridorText(FLIGHT)]).toEqual([null, null]);
  });
});

describe('an offboard mission in flight', () => {
  it('offers only the commands of its state', () => {
    expect(availableCommands(FLIGHT)).toEqual(['pause', 'skip', 'abort']);
    expect(availableCommands(flightWith({ others: ['2'] }))).toEqual(['pause', 'abort']);
    expect(availableCommands(flightWith({ state: 'paused' }))).toEqual(['resume', 'skip', 'abort']);
    expect(availableCommands(flightWith({ state: 'suspended', question: 'Sharp?' }))).toEqual(['resume', 'skip', 'abort']);
    expect(availableCommands(flightWith({ state: 'waiting', question: 'Sharp?' }))).toEqual(['go_on', 'pause', 'skip', 'abort']);
    for (const state of ['done', 'aborted', 'stopped'] as const) expect(availableCommands(flightWith({ state }))).toEqual([]);
  });

  it('needs a confirmation for commands except pause and continue', () => {
    expect(commandTexts('pause', FLIGHT, 'Quad 1')).toBeNull();
    expect(commandTexts('go_on', FLIGHT, 'Quad 1')).toBeNull();
    expect(commandTexts('resume', FLIGHT, 'Quad 1')?.effect).toContain('“Approach”');
    expect(commandTexts('skip', flightWith({ title: null }), 'Quad 1')?.title).toBe('Skip the current step');
    expect(commandTexts('abort', FLIGHT, 'Quad 1')?.verb).toBe('Abort');
  });

  it('has texts for progress, position error and state', () => {
    expect(flightProgress(FLIGHT)).toBeCloseTo(0.25);
    expect(flightProgress(flightWith({ remaining_s: null }))).toBeNull();
    expect(flightProgress(flightWith({ duration_s: 0 }))).toBeNull();
    expect(flightProgress(flightWith({ remaining_s: 500 }))).toBe(0);
    expect(deviationText(FLIGHT)).toBe('0.3 m position error');
    expect(deviationText(flightWith({ deviation_m: null }))).toBeNull();
    expect(stateLabel(flightWith({ state: 'suspended' }))).toEqual({ text: 'Interrupted by another mode', tone: 'caution' });
    expect(stateLabel(flightWith({ state: 'not_following' }))).toMatchObject({ tone: 'caution' });
    expect(lastFlightText(flightWith({ state: 'aborted' }), 'Quad 1')).toBe(`Last flight of “${FLIGHT.name}” by Quad 1: aborted.`);
    expect(stateLabel(flightWith({ state: 'starting' })).text).toBe('Switching to Offboard');
    expect(stateLabel(flightWith({ state: 'starting', mode: 'external_1' })).text).toBe('Starting');
    expect([hasEnded(FLIGHT), hasEnded(flightWith({ state: 'done' }))]).toEqual([false, true]);
  });
});

describe('starting an offboard mission', () => {
  it('is not possible with an error, before a check, or during another mission', () => {
    expect(startProblem([], null)).toBeNull();
    expect(startProblem(null, null)).toContain('not been checked');
    expect(startProblem([error('It leaves the fence.')], null)).toBe('An error to fix or accept below: It leaves the fence.');
    expect(startProblem([], FLIGHT)).toContain('Abort it first');
    expect(startProblem([], flightWith({ state: 'aborted' }))).toBeNull();
  });

  it('lists the failsafe actions for battery, control, link and server', () => {
    const { title, effect } = startTexts(MISSION, 'Quad 1', 65, 2, 'after 1 s the vehicle lands.');
    expect(title).toBe('Fly “Tower” with Quad 1');
    expect(effect).toContain('Arms, takes off and flies 2 steps, about 1 min 05 s. The check found 2 warnings.');
    expect(effect).toContain('Low battery: the vehicle lands. If the controlling client is lost: the vehicle holds.');
    expect(effect).toContain(
      'If the server fails or loses the connection to the vehicle: after 1 s the vehicle lands. Once a lost connection is restored: the vehicle holds. Hold interrupts',
    );
    expect(startTexts(MISSION, 'Quad 1', null, 0, null).effect).toContain('not known yet');
    const withErrors = startTexts(MISSION, 'Quad 1', null, 0, null, ['step 2: It leaves the fence.']);
    expect(withErrors.effect).toContain('You accepted 1 error: step 2: It leaves the fence. Low battery');
    expect([startTexts(MISSION, 'Quad 1', null, 0, null).danger, withErrors.danger]).toEqual([false, true]);
  });
});
