/** Makes the items of patterns whose values have been changed: by the form, by a drag, by undo, or in a copy. */

import type { PlanApi } from '../api';
import { isPatternItem, type PatternItem } from '../document/document';
import { altitudeOf, isStale } from '../document/pattern-items';
import type { PlanEditor } from '../editor/editor.svelte';
import { GROUND_TOLERANCE_M, fieldProblemText } from './drawing.svelte';

export class PatternUpdates {
  /** Why a pattern has no items; by the pattern, so that a changed one is tried again. */
  private problems = $state.raw<ReadonlyMap<PatternItem, string>>(new Map());

  constructor(
    private readonly api: PlanApi,
    private readonly editor: PlanEditor,
  ) {}

  /** The first pattern whose items belong to earlier values; null: none. */
  readonly next: PatternItem | null = $derived.by(
    () => this.editor.plan.items.filter(isPatternItem).find((item) => isStale(item) && !this.problems.has(item)) ?? null,
  );

  problemOf(item: PatternItem): string | null {
    return this.problems.get(item) ?? null;
  }

  /** Requests the items of a pattern from the server, and puts them into the plan if the pattern is still the same. */
  async update(item: PatternItem, vehicle: string | null): Promise<void> {
    const tolerance_m = altitudeOf(item.pattern).reference === 'terrain' ? GROUND_TOLERANCE_M : null;
    const answer = await this.api.pattern(item.pattern, 'waypoint_plan', vehicle, tolerance_m);
    if (answer.ok) this.editor.completePattern(item, answer.value.plan);
    else this.problems = new Map([[item, answer.ok ? 'The server made no path.' : fieldProblemText(answer.problem)]]);
  }
}
