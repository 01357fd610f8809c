/** The tables of a mission: trajectories as CSV text, by name. Pure functions. */

import { setStep } from './edit';
import type { Mission, Step, StepNode } from './mission';

/** Limits of the document format. */
export const MAX_TABLES = 20;
const MAX_NAME_LENGTH = 100;

/** A trajectory from a file, as the server read it. */
export interface Table {
  readonly name: string;
  readonly text: string;
}

/** All steps, including those of lists that no step calls. */
function allSteps(mission: Mission): Step[] {
  const lists = [mission.steps, ...Object.values(mission.roles ?? {}).map((role) => role.steps), ...Object.values(mission.missions)];
  const withNestedSteps = (steps: readonly Step[]): Step[] =>
    steps.flatMap((step) => [step, ...withNestedSteps(step.steps ?? []), ...withNestedSteps(step.then ?? []), ...withNestedSteps(step.otherwise ?? [])]);
  return lists.flatMap(withNestedSteps);
}

/** The name of the table, with a number if the mission has another table with this name and other content. */
function uniqueName(tables: Readonly<Record<string, string>>, { name, text }: Table): string {
  let candidate = name;
  for (let number = 2; tables[candidate] !== undefined && tables[candidate] !== text; number += 1) {
    const suffix = ` ${number}.csv`;
    candidate = name.replace(/\.csv$/, '').slice(0, MAX_NAME_LENGTH - suffix.length) + suffix;
  }
  return candidate;
}

/**
 * Stores a table in the mission and makes the step fly it. The previous table of the step is removed unless another
 * step uses it.
 * @returns null: the mission has too many tables.
 */
export function withTable(mission: Mission, node: StepNode, table: Table): Mission | null {
  const oldName = node.step['file'];
  const withoutTable = setStep(mission, node, { ...node.step, file: null });
  const isStillUsed = allSteps(withoutTable).some((step) => step['file'] === oldName);
  const keptTables = Object.fromEntries(Object.entries(mission.tables ?? {}).filter(([name]) => isStillUsed || name !== oldName));
  const name = uniqueName(keptTables, table);
  if (keptTables[name] === undefined && Object.keys(keptTables).length >= MAX_TABLES) return null;
  return setStep({ ...mission, tables: { ...keptTables, [name]: table.text } }, node, { ...node.step, file: name });
}
