/** One command to several vehicles, with one confirmation: which vehicles get it, and why others do not. */

import { ofVehicle, type ApiClient, type Outcome } from '../../api/client';
import type { Problem } from '../../api/problems';
import { ACTION_NAMES, actionFacts, reasonUnavailable, sendAction, type ConfirmationTexts } from '../../app/actions/actions';
import type { CommandToConfirm } from '../../app/actions/command.svelte';
import { heightText } from '../../ui/format';
import { controlProblem, otherControlHolder } from '../../vehicle/control';
import type { VehicleFacts } from '../../vehicle/facts';

export const BATCH_ACTIONS = ['arm', 'takeoff', 'land', 'rtl', 'mission'] as const;
export type BatchAction = (typeof BATCH_ACTIONS)[number];
export const BATCH_NAMES: Readonly<Record<BatchAction, string>> = { ...ACTION_NAMES, mission: 'Start mission' };

/** A vehicle of the batch, with what the command needs besides its facts. */
export interface BatchVehicle {
  readonly facts: VehicleFacts;
  /** Number of items of the mission on the vehicle; null: not reported. */
  readonly missionCount: number | null;
}

/** Why a vehicle does not get the command; null: it gets it. @param key this page's key. */
export function batchRefusal(action: BatchAction, { facts, missionCount }: BatchVehicle, key: string | null): string | null {
  const state = { ...actionFacts(facts, 0), lost: facts.lost, replayed: facts.replayed };
  const reason = reasonUnavailable(action === 'mission' ? 'arm' : action, state);
  if (reason !== null) return reason;
  if (action === 'arm' && state.armed) return 'It is armed already.';
  if (action === 'mission' && (missionCount ?? 0) === 0) return 'It has no mission.';
  if (action === 'mission' && state.armed && state.mode === 'mission') return 'It is flying its mission already.';
  return controlProblem(action, otherControlHolder(facts.control, key))?.detail ?? null;
}

export interface BatchPlan {
  readonly ready: readonly BatchVehicle[];
  readonly refused: readonly { readonly name: string; readonly reason: string }[];
}

export function batchPlan(action: BatchAction, vehicles: readonly BatchVehicle[], key: string | null): BatchPlan {
  const refusals = vehicles.map((vehicle) => ({ vehicle, reason: batchRefusal(action, vehicle, key) }));
  return {
    ready: refusals.filter(({ reason }) => reason === null).map(({ vehicle }) => vehicle),
    refused: refusals.flatMap(({ vehicle, reason }) => (reason === null ? [] : [{ name: vehicle.facts.name, reason }])),
  };
}

const namesOf = (vehicles: readonly BatchVehicle[]): string => vehicles.map(({ facts }) => facts.name).join(', ');
const refusalsText = (refused: BatchPlan['refused']): string => refused.map(({ name, reason }) => `${name}: ${reason}`).join(' ');

function effectOf(action: BatchAction, vehicles: readonly BatchVehicle[], takeoffAlt_home_m: number): string {
  const each = vehicles.length === 1 ? 'The vehicle' : 'Each vehicle';
  switch (action) {
    case 'arm':
      return `${each} starts its motors on the ground; in Mission, Take off or an external mode it flies at once.`;
    case 'takeoff':
      return `${each} arms, climbs to ${heightText(takeoffAlt_home_m)} above home and holds there.`;
    case 'land':
      return `${each} descends at its current position and disarms.`;
    case 'rtl':
      return `${each} climbs to its return altitude, flies home and lands. Vehicles with homes side by side return at the same altitude: keep them apart.`;
    case 'mission':
      return `${each} flies the mission stored on it: on the ground it arms and begins with the first item, in the air it continues at its current item.`;
  }
}

/** @param plan at least one vehicle is ready. */
export function batchTexts(action: BatchAction, { ready, refused }: BatchPlan, takeoffAlt_home_m: number): ConfirmationTexts {
  const leftOut = refused.length === 0 ? '' : ` Left out: ${refusalsText(refused)}`;
  const name = BATCH_NAMES[action];
  return { title: `${name}: ${namesOf(ready)}`, effect: `${effectOf(action, ready, takeoffAlt_home_m)}${leftOut}`, verb: name, danger: false };
}

function sendTo(api: ApiClient, action: BatchAction, { facts }: BatchVehicle, takeoffAlt_home_m: number): Promise<Outcome<unknown>> {
  if (action !== 'mission') return sendAction(api, action, actionFacts(facts, takeoffAlt_home_m));
  return facts.inAir
    ? api.post('/vehicles/{v}/mission/resume', { ...ofVehicle(facts.id), body: { despite: [] } })
    : api.post('/vehicles/{v}/mission/start', { ...ofVehicle(facts.id), body: { item: 0, despite: [] } });
}

/** The outcome for all vehicles; a refusal names each vehicle that the server refused. */
function combined(plan: BatchPlan, outcomes: readonly Outcome<unknown>[]): Outcome<unknown> {
  const refused = plan.ready.flatMap(({ facts }, index) => {
    const outcome = outcomes[index];
    return outcome === undefined || outcome.ok ? [] : [{ name: facts.name, problem: outcome.problem }];
  });
  const [first] = refused;
  if (first === undefined) return { ok: true, value: null };
  const texts = refused.map(({ name, problem }) => ({ name, reason: [problem.detail, ...problem.reasons].filter(Boolean).join(' ') }));
  const detail = `${plan.ready.length - refused.length} of ${plan.ready.length} done. ${refusalsText(texts)}`;
  const problem: Problem = { ...first.problem, title: 'Refused', detail, reasons: [], remedy: null, code: 'refused' };
  return { ok: false, problem };
}

/** The command to the ready vehicles, all at once. @param takeoffAlt_home_m reads the altitude that a person has typed. */
export function batchCommand(api: ApiClient, action: BatchAction, plan: BatchPlan, takeoffAlt_home_m: () => number): CommandToConfirm {
  return {
    name: BATCH_NAMES[action],
    vehicles: plan.ready.map(({ facts }) => facts.id),
    vehicleNames: namesOf(plan.ready),
    stops: action === 'land' || action === 'rtl',
    texts: () => batchTexts(action, plan, takeoffAlt_home_m()),
    send: async () => combined(plan, await Promise.all(plan.ready.map((vehicle) => sendTo(api, action, vehicle, takeoffAlt_home_m())))),
  };
}
