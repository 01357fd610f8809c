/** Starts the mission on a vehicle: at its beginning, at the current item, or at a chosen item. Pure. */

import type { Question } from '../../../app/actions/actions';
import { findingCodes, acceptedErrorsText, findingText } from './accepted-errors.svelte';
import { simpleItems, type Plan } from '../document/document';
import type { Finding } from '../document/fixes';

/** The vehicle's index of the first item of a row. A pattern is one row with several items. */
export function itemOfRow(plan: Plan, row: number): number {
  return simpleItems({ ...plan, items: plan.items.slice(0, row) }).length;
}

/** @param row the row to start at; null: the beginning, or the current item in flight. */
export function startQuestion(vehicleName: string, inAir: boolean, row: number | null, despite: readonly Finding[], dryRun: string | null = null): Question {
  const from = row === null ? (inAir ? 'its current step' : 'its first step') : `step ${row + 1}`;
  const flies = inAir ? `Flies to ${from} and continues from there.` : `Arms, takes off and flies the mission stored on the vehicle from ${from}.`;
  return {
    title: `Fly the mission of ${vehicleName}${row === null ? '' : ` from step ${row + 1}`}`,
    effect: [flies, acceptedErrorsText(despite.map(findingText)), dryRun === null ? '' : 'The flight is compared with the dry run.', 'Hold pauses the mission.']
      .filter((part) => part !== '')
      .join(' '),
    verb: 'Fly',
    danger: despite.length > 0,
  };
}

/** @param dryRun the dry run to compare the flight with; null: none. */
export function startBody(
  plan: Plan,
  inAir: boolean,
  row: number | null,
  despite: readonly Finding[],
  dryRun: string | null = null,
): { item?: number; despite: string[]; dry_run?: string } {
  const item = row !== null ? itemOfRow(plan, row) : inAir ? null : 0;
  return { ...(item === null ? {} : { item }), despite: findingCodes(despite), ...(dryRun === null ? {} : { dry_run: dryRun }) };
}
