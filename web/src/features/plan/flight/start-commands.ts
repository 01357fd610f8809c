/**
 * The commands that start, resume and control flights of plans. Each is fixed when it is made: vehicle, plan, texts and request.
 */

import { ofVehicle, type ApiClient, type Outcome } from '../../../api/client';
import type { components } from '../../../api/schema';
import type { Command, CommandToConfirm, FixedVehicles } from '../../../app/actions/command.svelte';
import type { VehicleFacts } from '../../../vehicle/facts';
import type { Plan } from '../document/document';
import type { Finding } from '../document/fixes';
import type { DryRunResult } from '../dry-run/dry-run.svelte';
import type { Mission } from '../offboard/mission';
import * as offboard from '../offboard/mission-flight';
import { selectTexts, type MissionMode } from '../offboard/mission-modes';
import type { SavedPlan } from '../plans.svelte';
import { findingCodes, findingText } from './accepted-errors.svelte';
import {
  continueTexts,
  dryRunIdFor,
  resumeBody,
  resumeTexts,
  startBody,
  startTexts,
  type ContinueChoice,
  type MissionProgress,
  type ResumeOffer,
} from './mission-start';

/** The errors that a person has accepted before a start. */
interface Acceptance {
  /** Accepted errors of the plan. */
  readonly acceptedErrors: readonly Finding[];
}

const NAME = 'Mission';

/** Texts and codes of all accepted errors. */
function accepted({ acceptedErrors }: Acceptance) {
  return { codes: findingCodes(acceptedErrors), texts: acceptedErrors.map(findingText) };
}

/** The body with the codes of findings that were accepted after a refused start. */
const withCodes = <T extends { readonly despite: readonly string[] }>(body: T, codes: readonly string[]): T => ({
  ...body,
  despite: [...new Set([...body.despite, ...codes])],
});

export interface PlanStart extends Acceptance {
  readonly plan: Plan;
  /** Row at which the flight starts; null: the first item, or in the air the current item. */
  readonly row: number | null;
  /** The vehicle's checksum of the plan, as the person saw it on the vehicle; 0: the vehicle reports none. */
  readonly missionId: number;
  readonly dryRun: DryRunResult | null;
  readonly progress: MissionProgress | null;
  /** Whether the vehicle is in the air now, and its current item; read while the confirmation is open. */
  readonly stateNow: () => { readonly inAir: boolean; readonly current: number | null };
}

/** Starts the waypoint plan on the vehicle. */
export function startPlanCommand(api: ApiClient, { id, name, inAir, globalPosition }: VehicleFacts, start: PlanStart): CommandToConfirm {
  const { plan, row, progress } = start;
  const { codes, texts } = accepted(start);
  const dryRunId = inAir ? null : dryRunIdFor(start.dryRun, id, globalPosition?.value ?? null);
  const body = startBody(plan, inAir, row, codes, start.missionId, dryRunId);
  const confirmation = startTexts(name, inAir, row, texts, dryRunId, progress);
  const changed = (): string | null => {
    const now = start.stateNow();
    if (now.inAir !== inAir) return `${name} has ${now.inAir ? 'taken off' : 'landed'} since the command was given.`;
    const isOtherItem = inAir && row === null && progress !== null && now.current !== progress.current;
    return isOtherItem ? `The current item of ${name} has changed since the command was given.` : null;
  };
  const send = (despite: readonly string[]) => api.post('/vehicles/{v}/mission/start', { ...ofVehicle(id), body: withCodes(body, despite) });
  return { name: NAME, vehicles: [id], vehicleNames: name, texts: () => confirmation, changed, acceptsFindings: true, send };
}

/**
 * Lets a flying vehicle resume its mission, skip to an item, or restart. The server never arms a vehicle for it.
 * @param mission the mission as the person saw it; `mission_id` 0: the vehicle reports none.
 */
export function continueCommand(
  api: ApiClient,
  { id, name }: VehicleFacts,
  choice: ContinueChoice,
  mission: MissionProgress & { readonly mission_id: number },
  stateNow: PlanStart['stateNow'],
): CommandToConfirm {
  const texts = continueTexts(name, choice, mission);
  const changed = (): string | null => {
    const now = stateNow();
    if (!now.inAir) return `${name} has landed since the command was given.`;
    const isOtherItem = choice.does !== 'restart' && now.current !== mission.current;
    return isOtherItem ? `The current item of ${name} has changed since the command was given.` : null;
  };
  const body = { ...(choice.item === null ? {} : { item: choice.item }), ...(mission.mission_id === 0 ? {} : { mission_id: mission.mission_id }) };
  const send = (despite: readonly string[]) =>
    api.post('/vehicles/{v}/mission/resume', { ...ofVehicle(id), body: withCodes({ ...body, despite: [] }, despite) });
  return { name: NAME, vehicles: [id], vehicleNames: name, texts: () => texts, changed, acceptsFindings: true, send };
}

/** Resumes an interrupted flight of the plan on the vehicle. */
export function resumeCommand(api: ApiClient, { id, name }: VehicleFacts, offer: ResumeOffer, acceptance: Acceptance): CommandToConfirm {
  const { codes, texts } = accepted(acceptance);
  const body = resumeBody(offer, codes);
  const confirmation = resumeTexts(name, offer, texts);
  const send = (despite: readonly string[]) => api.post('/vehicles/{v}/mission/start', { ...ofVehicle(id), body: withCodes(body, despite) });
  return { name: NAME, vehicles: [id], vehicleNames: name, texts: () => confirmation, acceptsFindings: true, send };
}

interface OffboardStartInputs extends Acceptance {
  readonly findings: readonly Finding[];
  /** Estimated flight time; null: not known. */
  readonly time_s: number | null;
}

const warningCount = (findings: readonly Finding[]): number => findings.filter(({ severity }) => severity === 'warning').length;

/** Starts an offboard mission on one vehicle; the plan may still have to be saved. */
export class OffboardMissionStart {
  private readonly accepted: { readonly codes: readonly string[]; readonly texts: readonly string[] };
  private readonly dry_run: string | null;

  constructor(
    private readonly facts: VehicleFacts,
    private readonly mission: Mission,
    private readonly inputs: OffboardStartInputs & { readonly dryRun: DryRunResult | null },
  ) {
    this.accepted = accepted(inputs);
    this.dry_run = offboard.dryRunIdWithCorridor(inputs.dryRun, facts.id, facts.globalPosition?.value ?? null);
  }

  /** The command for the saved version. Reads the vehicle's failsafe from the server for the confirmation. */
  async command(api: ApiClient, { id: plan_id, version }: Pick<SavedPlan, 'id' | 'version'>): Promise<CommandToConfirm> {
    const { facts, mission, inputs } = this;
    const view = await api.get('/vehicles/{v}/offboard', ofVehicle(facts.id));
    const failsafe = (view.ok ? view.value.failsafe?.words : null) ?? facts.offboard?.ifStreamStops ?? null;
    const texts = offboard.startTexts(mission, facts.name, inputs.time_s, warningCount(inputs.findings), failsafe, this.accepted.texts);
    const body = { plan_id, version, despite: [...this.accepted.codes], dry_run: this.dry_run };
    const send = (despite: readonly string[]) => api.post('/vehicles/{v}/offboard_mission/start', { ...ofVehicle(facts.id), body: withCodes(body, despite) });
    return { name: NAME, vehicles: [facts.id], vehicleNames: facts.name, texts: () => texts, acceptsFindings: true, send };
  }
}

/** Starts a mission with roles on several vehicles. @param vehicles the vehicle of each role. */
export function rolesStart(
  mission: Mission,
  roles: readonly string[],
  vehicles: Readonly<Record<string, string>>,
  nameOf: (id: string) => string,
  inputs: OffboardStartInputs & { readonly ifStreamStops: string | null; readonly dry_run: string | null },
): (api: ApiClient, saved: Pick<SavedPlan, 'id' | 'version'>) => CommandToConfirm {
  const names = roles.map((role) => `${nameOf(vehicles[role] ?? '')} (${role})`).join(', ');
  const { codes, texts: acceptedTexts } = accepted(inputs);
  const texts = offboard.startTexts(mission, names, inputs.time_s, warningCount(inputs.findings), inputs.ifStreamStops, acceptedTexts);
  return (api, { id: plan_id, version }) => {
    const body = { plan_id, version, vehicles, despite: codes, dry_run: inputs.dry_run };
    const send = (despite: readonly string[]) => api.post('/offboard_missions/start', { body: withCodes(body, despite) });
    return { name: NAME, vehicles: Object.values(vehicles), vehicleNames: names, texts: () => texts, acceptsFindings: true, send };
  };
}

type MissionModes = Readonly<components['schemas']['MissionModesView']>;

/** Saves the mission if necessary, and registers it with PX4 as a flight mode. Null: the mission was not saved. */
export async function registerMode(
  api: ApiClient,
  vehicle: string,
  fixed: FixedVehicles,
  save: () => Promise<SavedPlan | null>,
  request: { readonly name: string; readonly despite: string[]; readonly defer_failsafes_s: number },
): Promise<Outcome<MissionModes> | null> {
  const saved = await save();
  if (saved === null) return null;
  const problem = fixed.problem();
  if (problem !== null) return { ok: false, problem };
  return api.post('/vehicles/{v}/mission_modes/register', { ...ofVehicle(vehicle), body: { plan_id: saved.id, version: saved.version, ...request } });
}

export function removeMode(api: ApiClient, vehicle: string, name: string): Promise<Outcome<MissionModes>> {
  return api.post('/vehicles/{v}/mission_modes/unregister', { ...ofVehicle(vehicle), body: { name } });
}

/** Selects the flight mode of a mission. @param inAirNow whether the vehicle is in the air, read while the confirmation is open. */
export function selectModeCommand(
  api: ApiClient,
  mode: MissionMode & { readonly mode: string },
  { id, name, inAir }: VehicleFacts,
  inAirNow: (id: string) => boolean,
): CommandToConfirm {
  const texts = selectTexts(mode, name, inAir);
  const changed = (): string | null => (inAirNow(id) === inAir ? null : `${name} has ${inAir ? 'landed' : 'taken off'} since the command was given.`);
  const send = (despite: readonly string[]) =>
    api.post('/vehicles/{v}/mode', { ...ofVehicle(id), body: { mode: mode.mode, ...(despite.length === 0 ? {} : { despite }) } });
  return { name: `Select mode ${mode.name}`, vehicles: [id], vehicleNames: name, texts: () => texts, changed, acceptsFindings: true, send };
}

/** Commands the offboard mission in flight. */
export function flightCommand(api: ApiClient, command: offboard.FlightCommand, { id, name }: Pick<VehicleFacts, 'id' | 'name'>): Command {
  const send = () =>
    command === 'abort'
      ? api.post('/vehicles/{v}/offboard_mission/abort', { ...ofVehicle(id), body: { then: 'hold' } })
      : api.post(`/vehicles/{v}/offboard_mission/${command}`, ofVehicle(id));
  return { name: offboard.COMMAND_NAMES[command], vehicles: [id], vehicleNames: name, stops: command === 'pause' || command === 'abort', send };
}
