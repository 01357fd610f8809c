/** The selected step of a mission. Pure functions. */

import { nodeOf } from './edit';
import { stepPlaceOf, pointRefOf, type Mission, type PointRef, type StepNode } from './mission';
import { pointLabel } from './mission-layer';
import { stepTitle } from './step-titles';

export interface SelectedStep {
  readonly node: StepNode;
  /** The selected point; null: the whole step. */
  readonly ref: PointRef | null;
  /** Title of the card that edits the step. */
  readonly title: string;
}

/** The selected step; null: no step is selected, or several steps are. */
export function selectedStep(mission: Mission, ids: readonly string[]): SelectedStep | null {
  const [firstId, ...otherIds] = ids;
  const node = firstId === undefined ? null : nodeOf(mission, firstId);
  if (firstId === undefined || node === null || otherIds.some((id) => stepPlaceOf(id) !== node.place)) return null;
  const ref = otherIds.length === 0 ? pointRefOf(firstId) : null;
  const ownTitle = stepTitle(node.step);
  const count = node.step.points?.length ?? 0;
  const title =
    ref?.field === 'points'
      ? `Point ${pointLabel(node, ref.index, count)}`
      : node.step.name != null && node.step.name !== ''
        ? ownTitle
        : `${ownTitle} ${node.numberText}`;
  return { node, ref: ref?.field === 'points' ? ref : null, title };
}
