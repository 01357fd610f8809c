/**
 * One gesture on an editable layer: a click selects, a drag moves, by pointer or by the crosshair's keys. Pure: gets
 * pixels and positions, calls the editor.
 */

import type { LayerEditor, LayerPoint } from '../../app/map-layers.svelte';
import { fromPixel, nearestWithin, toPixel, type MapView, type Pixel } from '../../vehicle/geo';

/** A pointer that moves less than this makes a click [px]. */
const CLICK_TOLERANCE_PX = 5;
/** Reach of a midpoint, as a fraction of the reach of a point. */
const MIDDLE_REACH = 0.7;

/** The point under a pointer; a point of the plan has priority over a midpoint. */
export function pointAt(view: MapView, at: Pixel, points: readonly LayerPoint[], reach_px: number): LayerPoint | null {
  const planPoints = points.filter((point) => point.mark !== 'middle');
  const midpoints = points.filter((point) => point.mark === 'middle');
  return nearestWithin(view, at, planPoints, reach_px) ?? nearestWithin(view, at, midpoints, reach_px * MIDDLE_REACH);
}

interface GrabbedPoint {
  point: LayerPoint;
  began: Pixel;
  /** Offset from the pointer to the point, so that the point does not jump to the pointer. */
  offset: Pixel;
  more: boolean;
  /** Id of the moving point; null: not moved yet. */
  moving: string | null;
  /** The point cannot move: the gesture is only a click. */
  fixed: boolean;
}

export class LayerGesture {
  private held: GrabbedPoint | null = null;

  constructor(private readonly editor: LayerEditor) {}

  get isHeld(): boolean {
    return this.held !== null;
  }

  down(view: MapView, at: Pixel, point: LayerPoint, more: boolean): void {
    const pixel = toPixel(view, point);
    this.held = { point, began: at, offset: { x: pixel.x - at.x, y: pixel.y - at.y }, more, moving: null, fixed: false };
  }

  /** Starts a move by keyboard. @returns false: the point cannot move. */
  grabByKeyboard(view: MapView, point: LayerPoint): boolean {
    this.down(view, toPixel(view, point), point, false);
    this.begin();
    if (this.held?.moving === null) this.held = null;
    return this.held !== null;
  }

  move(view: MapView, at: Pixel): void {
    const held = this.held;
    if (held === null || held.fixed) return;
    if (held.moving === null && Math.hypot(at.x - held.began.x, at.y - held.began.y) < CLICK_TOLERANCE_PX) return;
    if (held.moving === null) this.begin();
    if (held.moving !== null) this.editor.drag(held.moving, fromPixel(view, { x: at.x + held.offset.x, y: at.y + held.offset.y }));
  }

  /** The pointer was released: a moved point is dropped, an unmoved one selected. */
  up(): void {
    const held = this.held;
    this.held = null;
    if (held === null) return;
    if (held.moving !== null) this.editor.drop(true);
    else this.editor.pick(held.point.id, held.more);
  }

  /** Escape, or the system cancelled the pointer: all points go back. */
  cancel(): void {
    const moved = this.held?.moving != null;
    this.held = null;
    if (moved) this.editor.drop(false);
  }

  private begin(): void {
    if (this.held === null) return;
    this.held.moving = this.editor.grab(this.held.point.id);
    this.held.fixed = this.held.moving === null;
  }
}
