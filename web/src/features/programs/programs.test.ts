import { expect, it } from 'vitest';
import { countsText, Programs, programText, refusalText, setpointText, shownProgram, stateText, type Guard, type Program } from './programs.svelte';

const PROGRAM: Program = {
  address: '127.0.0.1:40000',
  system: 245,
  component: 190,
  kind: 'onboard controller',
  age_s: 0.1,
  messages: 100,
  commanding: true,
  setpoint: 'velocity_body',
  setpoints: 50,
  setpoint_rate_hz: 19.8,
  setpoints_late: 0,
  setpoints_refused: 0,
  limited: [],
  left_out: [],
  refusals: [],
};
const GUARD: Guard = {
  name: 'guard',
  url: 'udpin://127.0.0.1:14640?guard=ask',
  vehicle: '1',
  control: 'ask',
  client: 'survey',
  client_key: 'key',
  valid_for_s: 0.5,
  on_expiry: 'hold',
  same_for_s: 10,
  problem: null,
  paused: null,
  flying: false,
  programs: [PROGRAM],
};

it('a guarded link has one state, the most urgent first', () => {
  const silent = { ...PROGRAM, age_s: 3 };
  const unheard = { ...PROGRAM, age_s: null };
  expect(stateText({ ...GUARD, paused: 'Anna commanded “Hold”.', flying: true })).toBe('Overruled');
  expect(stateText({ ...GUARD, problem: 'No vehicle is connected.' })).toBe('Not connected');
  expect(stateText({ ...GUARD, flying: true })).toBe('Flies');
  expect(stateText({ ...GUARD, programs: [unheard] })).toBe('No program');
  expect(stateText({ ...GUARD, programs: [silent] })).toBe('Silent');
  expect(stateText({ ...GUARD, control: 'read' })).toBe('Reads');
  expect(stateText(GUARD)).toBe('Connected');
});

it('the program that commands is shown, otherwise the one that was heard last', () => {
  const older = { ...PROGRAM, address: 'a', commanding: false, age_s: 2 };
  const newer = { ...PROGRAM, address: 'b', commanding: false, age_s: 1 };
  expect(shownProgram({ ...GUARD, programs: [older, newer] })?.address).toBe('b');
  expect(shownProgram({ ...GUARD, programs: [newer, { ...older, commanding: true }] })?.address).toBe('a');
  expect(shownProgram({ ...GUARD, programs: [] })).toBeNull();
});

it('a program is described by what it is and what it sends', () => {
  expect(programText(PROGRAM)).toBe('onboard controller · 127.0.0.1:40000 · 245/190');
  expect(setpointText(PROGRAM)).toBe('Setpoint: velocity body at 20 Hz');
  expect(setpointText({ ...PROGRAM, setpoint_rate_hz: null })).toBe('Setpoint: velocity body, none in the last 2 s');
  expect(setpointText({ ...PROGRAM, setpoint: null })).toBeNull();
  expect(countsText(PROGRAM)).toBeNull();
  expect(countsText({ ...PROGRAM, setpoints_late: 2, setpoints_refused: 1 })).toBe('Setpoints: 2 late, 1 refused');
  expect(refusalText({ unix_s: 100, what: 'x', text: 'y', repeated: 3 }, 105)).toContain('3 times');
});

it('a vehicle has its own guarded links and those without a vehicle', () => {
  const programs = new Programs();
  programs.list = [GUARD, { ...GUARD, name: 'other', vehicle: '2' }, { ...GUARD, name: 'none', vehicle: null }];
  expect(programs.of('1').map((guard) => guard.name)).toEqual(['guard', 'none']);
});
