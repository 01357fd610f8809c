/** Starts the mission on a vehicle: at its beginning, at the current item, at a chosen item, or where it was interrupted. Pure. */

import type { components } from '../../../api/schema';
import type { Question } from '../../../app/actions/actions';
import { join, metres } from '../../../ui/format';
import { acceptedErrorsText } from './accepted-errors.svelte';
import { simpleItems, type Plan } from '../document/document';

/** The vehicle's index of the first item of a row. A pattern is one row with several items. */
function itemOfRow(plan: Plan, row: number): number {
  return simpleItems({ ...plan, items: plan.items.slice(0, row) }).length;
}

/**
 * @param row the row to start at; null: the beginning, or the current item in flight.
 * @param despite texts of the accepted errors.
 */
export function startQuestion(vehicleName: string, inAir: boolean, row: number | null, despite: readonly string[], dryRun: string | null = null): Question {
  const resumes = inAir && row === null;
  const from = row === null ? (inAir ? 'the current step of its mission' : 'the first step') : `step ${row + 1}`;
  const flies = inAir ? `The vehicle flies to ${from} and continues from there.` : `Arms, takes off and flies the mission stored on the vehicle from ${from}.`;
  return {
    title: `${resumes ? 'Resume' : 'Fly'} the mission of ${vehicleName}${row === null ? '' : ` from step ${row + 1}`}`,
    effect: [flies, acceptedErrorsText(despite), dryRun === null ? '' : 'The flight is compared with the dry run.', 'Hold pauses the mission.']
      .filter((part) => part !== '')
      .join(' '),
    verb: resumes ? 'Resume' : 'Fly',
    danger: despite.length > 0,
  };
}

/**
 * @param despite codes of the accepted errors.
 * @param dryRun the dry run to compare the flight with; null: none.
 */
export function startBody(
  plan: Plan,
  inAir: boolean,
  row: number | null,
  despite: readonly string[],
  dryRun: string | null = null,
): { item?: number; despite: string[]; dry_run?: string } {
  const item = row !== null ? itemOfRow(plan, row) : inAir ? null : 0;
  return { ...(item === null ? {} : { item }), despite: [...despite], ...(dryRun === null ? {} : { dry_run: dryRun }) };
}

/** An interrupted flight of the plan on the vehicle. */
export type ResumeOffer = Readonly<components['schemas']['ResumeOffer']>;

const REFERENCES = { home: 'above home', amsl: 'AMSL', terrain: 'above the ground' } as const;

export function resumeVerb({ item, count }: ResumeOffer): string {
  return `Resume at item ${item + 1} of ${count}…`;
}

/** How far the plan was flown. @param at when, as text. */
export function interruptedText({ interrupted_item, count }: ResumeOffer, at: string): string {
  return `Interrupted on the way to item ${interrupted_item + 1} of ${count}, ${at}.`;
}

/** The way from the ground to the item. */
function wayText({ item, title, altitude_m, altitude_reference, distance_m }: ResumeOffer): string {
  const { text, unit } = metres(distance_m);
  const far = distance_m === null ? '' : `${text} ${unit} `;
  return `Arms, climbs at its current position to ${metres(altitude_m).text} m ${REFERENCES[altitude_reference]} and flies ${far}straight to item ${item + 1} (${title.toLowerCase()}). It flies the rest of the mission from there.`;
}

/** @param despite texts of the accepted errors. */
export function resumeQuestion(vehicleName: string, offer: ResumeOffer, despite: readonly string[]): Question {
  return {
    title: `Resume the mission of ${vehicleName} at item ${offer.item + 1} of ${offer.count}`,
    effect: join([wayText(offer), ...offer.cautions, acceptedErrorsText(despite), 'Hold pauses the mission.'].filter(Boolean), ' '),
    verb: 'Resume',
    danger: despite.length > 0,
  };
}

/** The server refuses this start if the vehicle has another mission by now. */
export function resumeBody({ item, mission_id }: ResumeOffer, despite: readonly string[]): { item: number; mission_id: number; despite: string[] } {
  return { item, mission_id, despite: [...despite] };
}
