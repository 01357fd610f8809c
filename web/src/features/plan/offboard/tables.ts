/** The tables of a mission: trajectories as CSV text, by name. Pure. */

import { setStep } from './edit';
import type { Mission, Step, StepNode } from './mission';

/** The document's limits. */
export const MAX_TABLES = 20;
const MAX_NAME_LENGTH = 100;

/** A trajectory from a file, as the server read it. */
export interface Table {
  readonly name: string;
  readonly text: string;
}

/** All steps, also those of lists that no step calls. */
function allSteps(mission: Mission): Step[] {
  const lists = [mission.steps, ...Object.values(mission.roles ?? {}).map((role) => role.steps), ...Object.values(mission.missions)];
  const flat = (steps: readonly Step[]): Step[] =>
    steps.flatMap((step) => [step, ...flat(step.steps ?? []), ...flat(step.then ?? []), ...flat(step.otherwise ?? [])]);
  return lists.flatMap(flat);
}

/** The name of the table, with a number if the mission has another table with this name and other content. */
function freeName(tables: Readonly<Record<string, string>>, { name, text }: Table): string {
  let candidate = name;
  for (let number = 2; tables[candidate] !== undefined && tables[candidate] !== text; number += 1) {
    const end = ` ${number}.csv`;
    candidate = name.replace(/\.csv$/, '').slice(0, MAX_NAME_LENGTH - end.length) + end;
  }
  return candidate;
}

/**
 * Stores a table in the mission and makes the step fly it. The previous table of the step is removed unless another
 * step uses it.
 * @returns null: the mission has too many tables.
 */
export function withTable(mission: Mission, node: StepNode, table: Table): Mission | null {
  const old = node.step['file'];
  const others = setStep(mission, node, { ...node.step, file: null });
  const isUsed = allSteps(others).some((step) => step['file'] === old);
  const kept = Object.fromEntries(Object.entries(mission.tables ?? {}).filter(([name]) => isUsed || name !== old));
  const name = freeName(kept, table);
  if (kept[name] === undefined && Object.keys(kept).length >= MAX_TABLES) return null;
  return setStep({ ...mission, tables: { ...kept, [name]: table.text } }, node, { ...node.step, file: name });
}
