/** The selected step of a mission. Pure. */

import { nodeOf } from './edit';
import { stepNameOf, pointOf, type Mission, type PointRef, type StepNode } from './mission';
import { pointMark } from './mission-layer';
import { stepTitle } from './step-titles';

export interface SelectedStep {
  readonly node: StepNode;
  /** The selected point; null: the whole step. */
  readonly ref: PointRef | null;
  /** Title of the editor. */
  readonly title: string;
}

/** The selected step; null: no step is selected, or several steps are. */
export function stepOf(mission: Mission, ids: readonly string[]): SelectedStep | null {
  const [firstId, ...otherIds] = ids;
  const node = firstId === undefined ? null : nodeOf(mission, firstId);
  if (firstId === undefined || node === null || otherIds.some((id) => stepNameOf(id) !== node.place)) return null;
  const ref = otherIds.length === 0 ? pointOf(firstId) : null;
  const ownTitle = stepTitle(node.step);
  const count = node.step.points?.length ?? 0;
  const title =
    ref?.field === 'points'
      ? `Point ${pointMark(node, ref.index, count)}`
      : node.step.name != null && node.step.name !== ''
        ? ownTitle
        : `${ownTitle} ${node.mark}`;
  return { node, ref: ref?.field === 'points' ? ref : null, title };
}
