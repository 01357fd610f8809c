/**
 * Texts and request bodies that start the mission on a vehicle. It starts at the first, the current or a chosen item, or
 * where the flight was interrupted. Pure functions.
 */

import type { DryRunResult } from '../dry-run/dry-run.svelte';
import { inSentence } from '../../../app/language';
import { isSameStart, type GeoPosition } from '../../../vehicle/geo';
import type { components } from '../../../api/schema';
import type { Status } from '../../../live/topics';
import type { ConfirmationTexts } from '../../../app/actions/actions';
import { distanceText, duration, heightText, join, lengthText } from '../../../ui/format';
import { acceptedErrorsText } from './accepted-errors.svelte';
import { simpleItems, type Plan } from '../document/document';

/** Index of a row's first item in the mission on the vehicle. A pattern is one row with several items. */
function itemOfRow(plan: Plan, row: number): number {
  return simpleItems({ ...plan, items: plan.items.slice(0, row) }).length;
}

/** The current item of the mission on the vehicle, counted from 0, and the number of items. */
export type MissionProgress = Readonly<{ current: number; count: number | null }>;

function currentItemText(progress: MissionProgress | null): string {
  return progress === null
    ? 'the current item of its mission'
    : `item ${progress.current + 1}${progress.count === null ? '' : ` of ${progress.count}`} (current)`;
}

/** Text of the button that continues the mission in the air. */
function continueButtonText(progress: MissionProgress | null): string {
  return progress === null ? 'Resume…' : `Resume at item ${progress.current + 1}${progress.count === null ? '' : ` of ${progress.count}`}…`;
}

/** What decides the main button of the bar of a plan on the vehicle. */
export interface BarState {
  /** The vehicle is armed in Mission mode. */
  readonly flies: boolean;
  readonly inAir: boolean;
  /** Exactly the saved plan is on the vehicle. */
  readonly isOnVehicle: boolean;
  readonly hasItems: boolean;
  readonly isSaved: boolean;
  /** An interrupted flight can be resumed. */
  readonly resumes: boolean;
  readonly progress: MissionProgress | null;
}

/** The main button; null while the vehicle flies a mission: there is nothing to start, to resume or to upload. */
export function mainButton(state: BarState): { readonly does: 'fly' | 'upload'; readonly text: string } | null {
  const { flies, inAir, isOnVehicle, hasItems, isSaved, resumes, progress } = state;
  if (flies && (inAir || !isOnVehicle)) return null;
  if (isOnVehicle) return { does: 'fly', text: inAir ? continueButtonText(progress) : resumes ? 'Fly from the beginning…' : 'Fly…' };
  return hasItems ? { does: 'upload', text: isSaved ? 'Upload' : 'Save and upload' } : null;
}

/** Text about a vehicle that is flying its mission. */
export function flyingText(progress: MissionProgress | null): string {
  return progress === null ? 'It is being flown.' : `It is being flown: item ${progress.current + 1}${progress.count === null ? '' : ` of ${progress.count}`}.`;
}

/**
 * @param row the row to start at; null: the first item, or in the air the current item.
 * @param acceptedTexts texts of the accepted errors.
 * @param dryRunId the dry run to compare the flight with; null: none.
 * @param progress progress of the mission; null: not reported.
 */
export function startTexts(
  vehicleName: string,
  inAir: boolean,
  row: number | null,
  acceptedTexts: readonly string[],
  dryRunId: string | null = null,
  progress: MissionProgress | null = null,
): ConfirmationTexts {
  const isResume = inAir && row === null;
  const startItem = row === null ? (inAir ? currentItemText(progress) : 'the first item') : `item ${row + 1}`;
  const path = inAir
    ? `The vehicle flies to ${startItem} and continues from there.`
    : `Arms, takes off and flies the mission stored on the vehicle from ${startItem}.`;
  return {
    title: `${isResume ? 'Resume' : 'Fly'} the mission of ${vehicleName}${row === null ? '' : ` from item ${row + 1}`}`,
    effect: [
      path,
      acceptedErrorsText(acceptedTexts),
      dryRunId === null ? '' : 'The flight is compared with the dry run.',
      'Hold interrupts the mission; you can resume it.',
    ]
      .filter((part) => part !== '')
      .join(' '),
    verb: isResume ? 'Resume' : 'Fly',
    danger: acceptedTexts.length > 0,
  };
}

/** What a flying vehicle does with its mission. `item`: index of the item to fly to; null: the current item. */
export interface ContinueChoice {
  readonly does: 'resume' | 'skip' | 'restart';
  readonly item: number | null;
}

/** The confirmation of a command to a flying vehicle about its mission. */
export function continueTexts(vehicleName: string, { does, item }: ContinueChoice, progress: MissionProgress): ConfirmationTexts {
  if (does === 'resume' || item === null) return startTexts(vehicleName, true, null, [], null, progress);
  const count = progress.count === null ? '' : ` of ${progress.count}`;
  const straight = `The vehicle flies straight from its current position to item ${item + 1}${count} and continues from there.`;
  if (does === 'restart')
    return { title: `Restart the mission of ${vehicleName}`, effect: `${straight} It flies the whole mission again.`, verb: 'Restart', danger: false };
  const left = item - progress.current;
  const leftOut = left < 1 ? '' : left === 1 ? ` It leaves out item ${progress.current + 1}.` : ` It leaves out items ${progress.current + 1} to ${item}.`;
  return { title: `Skip to item ${item + 1}${count} of the mission of ${vehicleName}`, effect: `${straight}${leftOut}`, verb: 'Skip', danger: false };
}

/** The body of the request to start. The server refuses the start if the mission on the vehicle has another `mission_id`. */
export interface StartBody {
  readonly item?: number;
  readonly despite: string[];
  readonly dry_run?: string;
  readonly mission_id?: number;
}

/**
 * @param acceptedCodes codes of the accepted errors.
 * @param missionId the vehicle's checksum of the plan that the person saw on the vehicle; 0: the vehicle reports none.
 * @param dryRunId the dry run to compare the flight with; null: none.
 */
export function startBody(
  plan: Plan,
  inAir: boolean,
  row: number | null,
  acceptedCodes: readonly string[],
  missionId: number,
  dryRunId: string | null = null,
): StartBody {
  const item = row !== null ? itemOfRow(plan, row) : inAir ? null : 0;
  return {
    ...(item === null ? {} : { item }),
    despite: [...acceptedCodes],
    ...(dryRunId === null ? {} : { dry_run: dryRunId }),
    ...(missionId === 0 ? {} : { mission_id: missionId }),
  };
}

/** An interrupted flight of the plan on the vehicle. */
export type ResumeOffer = Readonly<components['schemas']['ResumeOffer']>;

const REFERENCE_TEXTS = { home: 'above home', amsl: 'AMSL', terrain: 'above terrain' } as const;

export function resumeButtonText({ item, count }: ResumeOffer): string {
  return `Resume at item ${item + 1} of ${count}…`;
}

/** Text about where the flight was interrupted. @param age how long ago, such as "12 min ago". */
export function interruptedText({ interrupted_item, count }: ResumeOffer, age: string): string {
  return `Interrupted on the way to item ${interrupted_item + 1} of ${count}, ${age}.`;
}

/** Text about the path from the ground to the item. */
function pathText({ item, title, altitude_m, altitude_reference, distance_m }: ResumeOffer): string {
  const distance = distance_m === null ? '' : `${distanceText(distance_m)} `;
  return `Arms, climbs at its current position to ${heightText(altitude_m)} ${REFERENCE_TEXTS[altitude_reference]} and flies ${distance}straight to item ${item + 1} (${inSentence(title)}). It flies the rest of the mission from there.`;
}

/** @param acceptedTexts texts of the accepted errors. */
export function resumeTexts(vehicleName: string, offer: ResumeOffer, acceptedTexts: readonly string[]): ConfirmationTexts {
  return {
    title: `Resume the mission of ${vehicleName} at item ${offer.item + 1} of ${offer.count}`,
    effect: join(
      [pathText(offer), ...offer.cautions, acceptedErrorsText(acceptedTexts), 'Hold interrupts the mission; you can resume it.'].filter(Boolean),
      ' ',
    ),
    verb: 'Resume',
    danger: acceptedTexts.length > 0,
  };
}

/** The body of the request to resume. */
export function resumeBody({ item, mission_id }: ResumeOffer, acceptedCodes: readonly string[]): StartBody {
  return { item, mission_id, despite: [...acceptedCodes] };
}

/** `planned_by` is the source of the planned path and times: `plan` for estimates from the plan's straight lines, or `dry_run`. */
export type WaypointFlight = Readonly<components['schemas']['WaypointFlightStatus']>;

const LABELS: Readonly<Record<WaypointFlight['state'], { text: string; tone: 'ok' | 'target' | 'caution' | 'dim' }>> = {
  flying: { text: 'Flying', tone: 'target' },
  paused: { text: 'Paused: not in Mission mode', tone: 'dim' },
  done: { text: 'Done', tone: 'ok' },
  stopped: { text: 'Ended early', tone: 'caution' },
};

export function flightLabel(flight: WaypointFlight): (typeof LABELS)[WaypointFlight['state']] {
  return LABELS[flight.state];
}

export function hasEnded(flight: WaypointFlight): boolean {
  return flight.state === 'done' || flight.state === 'stopped';
}

/** Whether a vehicle flies its mission now: in Mission mode, or in the Return that is an item of the mission. */
export function fliesMission(status: Pick<Status, 'mode' | 'armed'> | null, flight: WaypointFlight | null): boolean {
  if (status?.armed !== true) return false;
  return status.mode === 'mission' || (status.mode === 'rtl' && flight?.state === 'flying');
}

/** Elapsed part of the planned time, 0 to 1; null: not known. */
export function flightProgress({ duration_s, remaining_s }: WaypointFlight): number | null {
  if (duration_s === null || remaining_s === null || !(duration_s > 0)) return null;
  return Math.min(1, Math.max(0, 1 - remaining_s / duration_s));
}

/** Remaining time and deviation in one line; null: neither is known. */
export function flightText(flight: WaypointFlight): string | null {
  const remainingTime = flight.remaining_s === null ? null : `${flight.planned_by === 'plan' ? 'about ' : ''}${duration(flight.remaining_s)} remaining`;
  const parts = [remainingTime, deviationText(flight)].filter((part) => part !== null);
  return parts.length === 0 ? null : parts.join(' · ');
}

function deviationText({ deviation_horizontal_m: horizontal_m, deviation_vertical_m: up_m, planned_by }: WaypointFlight): string | null {
  if (horizontal_m === null || up_m === null) return null;
  const path = planned_by === 'dry_run' ? 'the path of the dry run' : 'the straight lines of the plan';
  return `${lengthText(horizontal_m)} beside and ${heightText(Math.abs(up_m))} ${up_m < 0 ? 'below' : 'above'} ${path}`;
}

/**
 * Id of the dry run to compare a flight with: a completed dry run of this vehicle from the same start; null: none.
 * @param position position of the vehicle on the ground.
 */
export function dryRunIdFor(result: DryRunResult | null, vehicle: string, position: GeoPosition | null): string | null {
  if (result === null || result.vehicle !== vehicle || !result.nominal.finished || position === null) return null;
  return isSameStart(position, result.nominal.origin) ? result.id : null;
}
