/** When the 3D view shows a whole plan without a click, and when its camera returns to where it was. Pure. */

import type { LayerPicture, LayerPosition } from '../../app/map-layers.svelte';
import type { Vector } from './scene-view';

/** Position of the camera and the point it looks at, in the page's scene. */
export interface CameraPose {
  readonly eye: Vector;
  readonly target: Vector;
}

/** A camera that has moved by less than this share of its distance has not been moved by a person. */
const SAME_SHARE = 0.001;

/** All positions that the 3D view shows. */
export function extentOf(pictures: readonly LayerPicture[]): LayerPosition[] {
  return pictures.flatMap(({ ground, points, lines, solids = [] }) => {
    if (ground === undefined) return [];
    const tops = solids.flatMap(({ ring, top_amsl_m }) => ring.map((at) => ({ ...at, alt_amsl_m: top_amsl_m })));
    return [...points, ...lines.flatMap(({ positions }) => positions), ...tops];
  });
}

/** A camera pose to set; `show`: the one that shows everything. */
type CameraMove = CameraPose | 'show' | null;

export class SceneOverview {
  /** The camera mode at the request; null: nothing is requested. */
  private requested: string | null = null;
  private grows = false;
  /** The camera before the overview, and where the overview has set it; null: a person has moved it since. */
  private shown: { readonly before: CameraPose; readonly set: CameraPose } | null = null;

  /** A plan was opened: shows it once, when the 3D view is large. */
  request(mode: string): void {
    this.requested = mode;
  }

  /** The plan that is shown is known completely now: shows it again, unless a person has moved the camera. */
  grow(): void {
    this.grows = this.shown !== null;
  }

  /** A person has moved the camera. */
  cancel(): void {
    [this.requested, this.grows, this.shown] = [null, false, null];
  }

  /** Whether `next` may return a move. */
  get isActive(): boolean {
    return this.requested !== null || this.shown !== null;
  }

  /**
   * The move of the camera in this frame; after `show`, the caller reports the new pose to `moved`.
   * @param follows whether a vehicle is flying, or the camera follows a dry run. The overview then shows nothing, and the
   *   camera returns to its pose before the overview.
   */
  next(now: CameraPose, mode: string, inset: boolean, follows: boolean): CameraMove {
    if (this.shown !== null && !isSame(this.shown.set, now)) [this.shown, this.grows] = [null, false];
    if (follows) return this.release(now);
    if (this.requested !== null && this.requested !== mode) this.requested = null;
    if (inset || (this.requested === null && !this.grows)) return null;
    [this.requested, this.grows] = [null, false];
    return mode === 'gimbal' ? null : 'show';
  }

  /** The overview has moved the camera. */
  moved(before: CameraPose, set: CameraPose): void {
    this.shown = { before: this.shown?.before ?? before, set };
  }

  /** The plan is not shown any more. @returns the camera's pose before the overview; null: it stays. */
  release(now: CameraPose): CameraPose | null {
    const back = this.shown !== null && isSame(this.shown.set, now) ? this.shown.before : null;
    this.cancel();
    return back;
  }
}

function isSame(a: CameraPose, b: CameraPose): boolean {
  const apart = (from: Vector, to: Vector): number => Math.hypot(from[0] - to[0], from[1] - to[1], from[2] - to[2]);
  return Math.max(apart(a.eye, b.eye), apart(a.target, b.target)) <= SAME_SHARE * apart(a.eye, a.target);
}
