/** Inserts a stored mission into the edited mission. The server merges the two documents. */

import type { InsertedMission, PlanApi, PositionHandling } from '../api';
import type { PlanEditor } from '../editor/editor.svelte';
import { fieldProblemText } from '../patterns/drawing.svelte';
import { stepIdAt, callInsertionPath } from './edit';

/** An offboard mission in the list of stored plans. */
export interface StoredMission {
  readonly id: string;
  readonly name: string;
}

export class MissionInsertion {
  isOpen = $state(false);
  /** The insertion leaves out the take-off and the last landing of the stored mission. */
  skipsTakeoffAndLanding = $state(true);
  busy = $state(false);
  /** Why the stored mission was not inserted. */
  problem = $state.raw<string | null>(null);
  /** The stored mission for which a person must choose how its positions are inserted. */
  missionAwaitingChoice = $state.raw<StoredMission | null>(null);
  private requestCount = 0;

  constructor(
    private readonly api: PlanApi,
    private readonly editor: PlanEditor,
  ) {}

  open(): void {
    this.editor.stopPlacing();
    this.isOpen = true;
  }

  /** Closes the form; the response to a running request is discarded. */
  close(): void {
    this.requestCount += 1;
    this.isOpen = false;
    this.busy = false;
    this.clearProblem();
  }

  private clearProblem(): void {
    [this.problem, this.missionAwaitingChoice] = [null, null];
  }

  /**
   * Inserts the stored mission after the selection, as one change.
   * @param positions how relative positions are inserted; null: the person has not chosen.
   * @returns null: the mission was not inserted, see `problem`.
   */
  async insert(storedMission: StoredMission, positions: PositionHandling | null = null): Promise<InsertedMission | null> {
    const { mission, draft, selected } = this.editor;
    if (mission === null || this.busy) return null;
    const callPath = callInsertionPath(mission, [...selected]);
    this.requestCount += 1;
    const requestNumber = this.requestCount;
    this.clearProblem();
    this.busy = true;
    const response = await this.api.insert(mission, callPath, storedMission.id, this.skipsTakeoffAndLanding, positions);
    if (requestNumber !== this.requestCount) return null;
    this.busy = false;
    if (!response.ok) {
      const awaitsChoice = response.problem.field === 'positions' && positions === null;
      this.missionAwaitingChoice = awaitsChoice ? storedMission : null;
      this.problem = fieldProblemText(awaitsChoice ? { ...response.problem, remedy: null } : response.problem);
      return null;
    }
    if (this.editor.draft !== draft) {
      this.problem = 'The mission was changed during the request. Try again.';
      return null;
    }
    this.editor.change(response.value.plan);
    const id = stepIdAt(response.value.plan, callPath);
    this.editor.select(id === null ? [] : [id]);
    this.close();
    return response.value;
  }
}
