/** When the camera of the 3D view moves to show an opened plan, and when it returns to its earlier pose. Pure functions. */

import type { LayerContent, LayerPosition } from '../../app/map-layers.svelte';
import type { Vector } from './scene-view';

/** Position of the camera, and the point that the camera looks at, in the coordinates of viser's scene. */
export interface CameraPose {
  readonly eye: Vector;
  readonly target: Vector;
}

/** Poses that differ by less than this fraction of the camera's distance from its target are the same. */
const SAME_FRACTION = 0.001;

/** All positions of the layers that the 3D view shows. */
export function scenePositions(contents: readonly LayerContent[]): LayerPosition[] {
  return contents.flatMap(({ ground, points, lines, solids = [] }) => {
    if (ground === undefined) return [];
    const tops = solids.flatMap(({ ring, top_amsl_m }) => ring.map((at) => ({ ...at, alt_amsl_m: top_amsl_m })));
    return [...points, ...lines.flatMap(({ positions }) => positions), ...tops];
  });
}

/** A pose to set; `show`: the pose that shows all layers; null: no move. */
type CameraMove = CameraPose | 'show' | null;

export class SceneOverview {
  /** The camera mode at the request; null: no request. */
  private requestedMode: string | null = null;
  /** Whether the plan must be shown again, because more of its path is known. */
  private refitRequested = false;
  /** The poses before the overview and in the overview; null: no overview, or a person has moved the camera. */
  private poses: { readonly earlier: CameraPose; readonly overview: CameraPose } | null = null;

  /** Requests that the opened plan is shown once, as soon as the 3D view is large. */
  request(mode: string): void {
    this.requestedMode = mode;
  }

  /** Requests that the plan is shown again, because its path is now known, unless a person has moved the camera. */
  refit(): void {
    this.refitRequested = this.poses !== null;
  }

  /** Ends the overview, because a person has moved the camera. */
  cancel(): void {
    [this.requestedMode, this.refitRequested, this.poses] = [null, false, null];
  }

  /** Whether `nextMove` may return a move. */
  get isActive(): boolean {
    return this.requestedMode !== null || this.poses !== null;
  }

  /**
   * The move of the camera in this frame; after `show`, the caller reports the new pose to `recordMove`.
   * @param mustFollow whether the camera must follow: a vehicle is flying, or the camera follows a dry run. The overview
   *   then ends, and the camera returns to its earlier pose.
   */
  nextMove(current: CameraPose, mode: string, inset: boolean, mustFollow: boolean): CameraMove {
    if (this.poses !== null && !isSame(this.poses.overview, current)) [this.poses, this.refitRequested] = [null, false];
    if (mustFollow) return this.end(current);
    if (this.requestedMode !== null && this.requestedMode !== mode) this.requestedMode = null;
    if (inset || (this.requestedMode === null && !this.refitRequested)) return null;
    [this.requestedMode, this.refitRequested] = [null, false];
    return mode === 'gimbal' ? null : 'show';
  }

  /** Reports that the camera was moved to show the plan. */
  recordMove(earlier: CameraPose, overview: CameraPose): void {
    this.poses = { earlier: this.poses?.earlier ?? earlier, overview };
  }

  /** Ends the overview. @returns the camera's pose before the overview; null: the camera stays. */
  end(current: CameraPose): CameraPose | null {
    const earlierPose = this.poses !== null && isSame(this.poses.overview, current) ? this.poses.earlier : null;
    this.cancel();
    return earlierPose;
  }
}

function isSame(a: CameraPose, b: CameraPose): boolean {
  const distance = (from: Vector, to: Vector): number => Math.hypot(from[0] - to[0], from[1] - to[1], from[2] - to[2]);
  return Math.max(distance(a.eye, b.eye), distance(a.target, b.target)) <= SAME_FRACTION * distance(a.eye, a.target);
}
