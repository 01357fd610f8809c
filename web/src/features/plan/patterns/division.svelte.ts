/** Divides a survey of the edited plan over several vehicles. The server makes a mission with a role for each part. */

import type { DividedSurvey, PlanApi } from '../api';
import { isPatternItem, type PatternItem } from '../document/document';
import type { PlanEditor } from '../editor/editor.svelte';
import type { RoleAssignment } from '../flight/accepted-errors.svelte';
import { fieldProblemText } from './drawing.svelte';

/** Longest name of a plan. */
const MAX_NAME = 100;

export class SurveyDivision {
  /** Row of the survey; null: the form is closed. */
  row = $state<number | null>(null);
  /** The chosen vehicles; empty: only their number. */
  vehicles = $state.raw<readonly string[]>([]);
  count = $state(3);
  minimumSeparation_m = $state(5);
  busy = $state(false);
  /** Why the survey was not divided. */
  problem = $state.raw<string | null>(null);
  private requestCount = 0;

  constructor(
    private readonly api: PlanApi,
    private readonly editor: PlanEditor,
    private readonly assignment: RoleAssignment,
  ) {}

  /** The survey that is divided; null: the form is closed, or the survey is no longer there. */
  readonly survey: PatternItem | null = $derived.by(() => {
    const item = this.row === null || this.editor.mission !== null ? undefined : this.editor.plan.items[this.row];
    return isPatternItem(item) && item.pattern.kind === 'survey' ? item : null;
  });

  open(row: number): void {
    this.editor.stopPlacing();
    this.vehicles = [];
    this.problem = null;
    this.row = row;
  }

  /** Closes the form; the response to a running request is discarded. */
  close(): void {
    this.requestCount += 1;
    this.row = null;
    this.busy = false;
  }

  choose(vehicle: string, chosen: boolean): void {
    this.vehicles = chosen ? [...this.vehicles, vehicle] : this.vehicles.filter((other) => other !== vehicle);
  }

  /**
   * Replaces the plan by the divided survey, and assigns the chosen vehicles. Undo restores the plan.
   * @returns null: the survey was not divided, see `problem`.
   */
  async divide(): Promise<DividedSurvey | null> {
    const { draft, plan } = this.editor;
    if (this.row === null || this.busy) return null;
    this.requestCount += 1;
    const requestNumber = this.requestCount;
    this.problem = null;
    this.busy = true;
    const name = `${draft.name.trim() || 'Survey'}, divided`.slice(-MAX_NAME);
    const response = await this.api.divide(plan, this.row, name, this.vehicles.length > 0 ? this.vehicles : this.count, this.minimumSeparation_m);
    if (requestNumber !== this.requestCount) return null;
    this.busy = false;
    if (!response.ok) {
      this.problem = fieldProblemText(response.problem);
      return null;
    }
    if (this.editor.draft !== draft) {
      this.problem = 'The plan was changed during the request. Try again.';
      return null;
    }
    this.editor.replace(name, response.value.plan);
    for (const { role, vehicle } of response.value.parts) this.assignment.choose(role, vehicle ?? '');
    this.close();
    return response.value;
  }
}
