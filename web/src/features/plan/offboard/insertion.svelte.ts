/** The choice of a stored mission that is inserted into the edited one. The server merges the two. */

import type { InsertedMission, PlanApi, Positions } from '../api';
import type { PlanEditor } from '../editor/editor.svelte';
import { fieldProblemText } from '../patterns/drawing.svelte';
import { idAt, pathOfCall } from './edit';

/** A plan of the list of stored plans. */
export interface StoredMission {
  readonly id: string;
  readonly name: string;
}

export class MissionInsertion {
  isOpen = $state(false);
  /** Leave out the take-off and the last landing of the stored mission. */
  inAir = $state(true);
  busy = $state(false);
  /** Why the stored mission was not inserted. */
  problem = $state.raw<string | null>(null);
  /** The stored mission for which the person must choose how its positions are inserted. */
  undecided = $state.raw<StoredMission | null>(null);
  private requests = 0;

  constructor(
    private readonly api: PlanApi,
    private readonly editor: PlanEditor,
  ) {}

  open(): void {
    this.editor.stopPlacing();
    this.isOpen = true;
  }

  /** Closes the choice; an answer that is still expected is discarded. */
  close(): void {
    this.requests += 1;
    this.isOpen = false;
    this.busy = false;
    this.clear();
  }

  private clear(): void {
    [this.problem, this.undecided] = [null, null];
  }

  /**
   * Inserts the stored mission after the selection, as one change.
   * @param positions null: the person has not decided.
   * @returns null: nothing was inserted, see `problem`.
   */
  async insert(stored: StoredMission, positions: Positions | null = null): Promise<InsertedMission | null> {
    const { mission, draft, selected } = this.editor;
    if (mission === null || this.busy) return null;
    const at = pathOfCall(mission, [...selected]);
    this.requests += 1;
    const number = this.requests;
    this.clear();
    this.busy = true;
    const answer = await this.api.insert(mission, at, stored.id, this.inAir, positions);
    if (number !== this.requests) return null;
    this.busy = false;
    if (!answer.ok) {
      const isUndecided = answer.problem.field === 'positions' && positions === null;
      this.undecided = isUndecided ? stored : null;
      this.problem = fieldProblemText(isUndecided ? { ...answer.problem, remedy: null } : answer.problem);
      return null;
    }
    if (this.editor.draft !== draft) {
      this.problem = 'The mission was changed during the request. Try again.';
      return null;
    }
    this.editor.change(answer.value.plan);
    const id = idAt(answer.value.plan, at);
    this.editor.select(id === null ? [] : [id]);
    this.close();
    return answer.value;
  }
}
