/** Agents (language models), and the flights that they ask for. They are not part of the telemetry, so the page polls them. */

import type { ApiClient } from '../../api/client';
import type { components } from '../../api/schema';
import { commandTo, type Command, type CommandToConfirm } from '../../app/actions/command.svelte';
import { ageText } from '../../live/age';
import { durationText } from '../../ui/format';
import type { VehicleFacts } from '../../vehicle/facts';

/** While an agent has called lately or asks for something, and while none has [ms]. */
const POLL_INTERVAL_MS = 1000;
const IDLE_INTERVAL_MS = 5000;
/** An agent that has called within this time is shown, and an answered request for this time after it was made [s]. */
const RECENT_S = 300;

export type Agent = components['schemas']['Agent'];
export type FlightRequest = components['schemas']['AgentFlightRequest'];

export class Agents {
  list = $state.raw<readonly Agent[]>([]);
  requests = $state.raw<readonly FlightRequest[]>([]);

  poll(api: ApiClient): void {
    const request = async (): Promise<void> => {
      await this.read(api);
      const active = this.list.some((agent) => isRecent(agent.last_call_unix_s));
      setTimeout(() => void request(), active ? POLL_INTERVAL_MS : IDLE_INTERVAL_MS);
    };
    void request();
  }

  async read(api: ApiClient): Promise<void> {
    const answer = await api.get('/agents');
    this.list = answer.ok ? answer.value.agents : [];
    this.requests = answer.ok ? answer.value.requests : [];
  }

  /** The agents to show beside a vehicle: those that have called lately, or that it waits for. */
  of(vehicle: string): readonly Agent[] {
    return this.list.filter((agent) => isRecent(agent.last_call_unix_s) || agent.controls.includes(vehicle) || vehicle in agent.paused);
  }

  /** The newest request of an agent for a vehicle; null: it has none that is recent. */
  requestOf({ name }: Agent, vehicle: string): FlightRequest | null {
    const newest = this.requests.find((request) => request.agent === name && request.vehicle === vehicle);
    return newest !== undefined && isRecent(newest.asked_unix_s) ? newest : null;
  }

  /** Whether a request still waits for a person. */
  waits({ id }: FlightRequest): boolean {
    return this.requests.some((request) => request.id === id && request.state === 'waiting');
  }
}

const isRecent = (unix_s: number | null): boolean => unix_s !== null && Date.now() / 1000 - unix_s < RECENT_S;

/** The state of an agent beside a vehicle in a word. */
export function agentStateText(agent: Agent, vehicle: string, request: FlightRequest | null): string {
  if (request?.state === 'waiting') return 'Asks';
  if (vehicle in agent.paused) return 'Overruled';
  if (agent.controls.includes(vehicle)) return 'Has control';
  return { read: 'Only reads', plan: 'May plan', simulated: 'May fly simulated vehicles', fly: 'May ask to fly' }[agent.scope] ?? agent.scope;
}

/** What an agent has called. */
export function callsText({ calls, refused, last_tool, last_call_unix_s }: Agent, now_unix_s: number): string {
  const last = last_tool === null || last_call_unix_s === null ? '' : ` Last: ${last_tool}, ${ageText(Math.max(0, now_unix_s - last_call_unix_s))} ago.`;
  return `${String(calls)} calls, ${String(refused)} refused.${last}`;
}

/** What an agent asks a person for. */
export function requestText({ plan_name, plan_version }: FlightRequest, vehicleName: string): string {
  return `Asks to fly “${plan_name}”, version ${String(plan_version)}, with ${vehicleName}.`;
}

/** What the dry run of a request says. */
export function dryRunText({ dry_run_age_s, duration_s, findings }: FlightRequest): string {
  const length = duration_s === null ? '' : ` It took ${durationText(duration_s)}.`;
  const warnings = findings === 0 ? ' No warnings.' : ` ${String(findings)} ${findings === 1 ? 'warning' : 'warnings'}.`;
  return `The dry run passed ${ageText(dry_run_age_s)} ago.${length}${warnings}`;
}

/** Allows the flight that an agent asks for. */
export function allowCommand(api: ApiClient, { id, name }: VehicleFacts, request: FlightRequest, waits: () => boolean): CommandToConfirm {
  const texts = {
    title: `Let agent ${request.agent} fly ${name}`,
    effect: `${name} arms, takes off and flies “${request.plan_name}”, version ${String(request.plan_version)}. Agent ${request.agent} has control; ${name} holds when the agent falls silent. ${dryRunText(request)}`,
    verb: 'Allow the flight',
    danger: true,
  };
  return {
    name: 'Allow the flight of an agent',
    vehicles: [id],
    vehicleNames: name,
    part: request.id,
    texts: () => texts,
    changed: () => (waits() ? null : 'The request does not wait any more.'),
    send: () => api.post('/agents/requests/{request}/allow', { params: { path: { request: request.id } } }),
  };
}

/** Refuses the flight that an agent asks for. */
export function refuseCommand(api: ApiClient, facts: VehicleFacts, request: FlightRequest): Command {
  const send = () => api.post('/agents/requests/{request}/refuse', { params: { path: { request: request.id } } });
  return commandTo(facts, 'Refuse the flight of an agent', send, { part: request.id });
}

/** Lets an overruled agent command a vehicle again. */
export function continueAgentCommand(api: ApiClient, { id, name }: VehicleFacts, agent: Agent): CommandToConfirm {
  const texts = {
    title: 'Let the agent continue',
    effect: `Agent ${agent.name} may command ${name} again, as far as its scope allows.`,
    verb: 'Slide to let it continue',
    danger: false,
  };
  const send = () => api.post('/agents/{name}/resume', { params: { path: { name: agent.name } }, body: { vehicle: id } });
  return { name: 'Let the agent continue', vehicles: [id], vehicleNames: name, part: agent.name, texts: () => texts, send };
}
