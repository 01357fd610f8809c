import { afterEach, beforeEach, expect, it, vi } from 'vitest';
import { agentStateText, Agents, allowCommand, callsText, dryRunText, requestText, type Agent, type FlightRequest } from './agents.svelte';

const NOW_S = 1_000_000;
const AGENT: Agent = {
  name: 'helper',
  scope: 'fly',
  client: 'agent helper',
  client_key: 'key',
  calls: 12,
  refused: 2,
  last_call_unix_s: NOW_S - 5,
  last_tool: 'takeoff',
  max_calls_per_min: 120,
  controls: [],
  paused: {},
  refusals: [],
};
const REQUEST: FlightRequest = {
  id: '7',
  agent: 'helper',
  vehicle: '1',
  plan_id: 'p',
  plan_version: 3,
  plan_name: 'Round',
  kind: 'waypoint_plan',
  dry_run_id: '4',
  dry_run_age_s: 40,
  duration_s: 62,
  findings: 1,
  state: 'waiting',
  text: 'Waits for a person.',
  asked_unix_s: NOW_S - 10,
  expires_in_s: 110,
};

beforeEach(() => {
  vi.useFakeTimers();
  vi.setSystemTime(NOW_S * 1000);
});
afterEach(() => {
  vi.useRealTimers();
});

it('an agent has one state beside a vehicle, the most urgent first', () => {
  expect(agentStateText({ ...AGENT, paused: { '1': 'Anna commanded Hold.' }, controls: ['1'] }, '1', REQUEST)).toBe('Asks');
  expect(agentStateText({ ...AGENT, paused: { '1': 'Anna commanded Hold.' }, controls: ['1'] }, '1', null)).toBe('Overruled');
  expect(agentStateText({ ...AGENT, controls: ['1'] }, '1', { ...REQUEST, state: 'started' })).toBe('Has control');
  expect(agentStateText({ ...AGENT, controls: ['2'] }, '1', null)).toBe('May ask to fly');
  expect(agentStateText({ ...AGENT, scope: 'read' }, '1', null)).toBe('Only reads');
});

it('agents that were silent for long are shown only beside the vehicles that they have or wait for', () => {
  const agents = new Agents();
  const silent = { ...AGENT, last_call_unix_s: NOW_S - 1000 };
  agents.list = [AGENT, { ...silent, name: 'silent' }, { ...silent, name: 'flies', controls: ['1'] }, { ...silent, name: 'waits', paused: { '1': 'x' } }];
  expect(agents.of('1').map((agent) => agent.name)).toEqual(['helper', 'flies', 'waits']);
  expect(agents.of('2').map((agent) => agent.name)).toEqual(['helper']);
});

it('a request is that of the agent and of the vehicle, the newest, and not an old one', () => {
  const agents = new Agents();
  agents.requests = [REQUEST, { ...REQUEST, id: '6', state: 'refused' }, { ...REQUEST, id: '5', vehicle: '2', asked_unix_s: NOW_S - 1000 }];
  expect(agents.requestOf(AGENT, '1')?.id).toBe('7');
  expect(agents.requestOf(AGENT, '2')).toBeNull();
  expect(agents.requestOf({ ...AGENT, name: 'other' }, '1')).toBeNull();
  expect(agents.waits(REQUEST)).toBe(true);
  agents.requests = [{ ...REQUEST, state: 'void' }];
  expect(agents.waits(REQUEST)).toBe(false);
});

it('the confirmation names agent, vehicle, plan and dry run, and lapses with the request', () => {
  let waits = true;
  const command = allowCommand(null as never, { id: '1', name: 'Vehicle 1' } as never, REQUEST, () => waits);
  expect(command.texts().title).toBe('Let agent helper fly Vehicle 1');
  expect(command.texts().effect).toContain('flies “Round”, version 3');
  expect(command.texts().effect).toContain('1 warning.');
  expect(command.texts().danger).toBe(true);
  expect(command.changed?.()).toBeNull();
  waits = false;
  expect(command.changed?.()).toBe('The request does not wait any more.');
});

it('what an agent did and asks for is said in sentences', () => {
  expect(callsText(AGENT, NOW_S)).toMatch(/^12 calls, 2 refused\. Last: takeoff, .+ ago\.$/);
  expect(callsText({ ...AGENT, last_tool: null }, NOW_S)).toBe('12 calls, 2 refused.');
  expect(requestText(REQUEST, 'Vehicle 1')).toBe('Asks to fly “Round”, version 3, with Vehicle 1.');
  expect(dryRunText({ ...REQUEST, findings: 0, duration_s: null })).toMatch(/^The dry run passed .+ ago\. No warnings\.$/);
});
