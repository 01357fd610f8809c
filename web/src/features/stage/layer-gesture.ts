/**
 * One gesture on an editable layer, on the map or in 3D: a click selects, a drag moves, by pointer or by the
 * crosshair's keys. Pure: gets pixels and positions, calls the editor.
 */

import type { LayerEditor, LayerPoint, LayerPosition } from '../../app/map-layers.svelte';
import { fromPixel, nearestWithin, toPixel, type GeoPosition, type MapView, type Pixel } from '../../vehicle/geo';

/** A pointer that moves less than this makes a click [px]. */
const CLICK_TOLERANCE_PX = 5;
/** Reach of a midpoint, as a fraction of the reach of a point. */
const MIDDLE_REACH = 0.7;

/** Converts between positions and pixels of the map or of the 3D view. */
export interface LayerView {
  /** Null: not visible. */
  readonly pixelOf: (at: LayerPosition) => Pixel | null;
  /** The position that a pixel shows at the altitude of `like`; null: there is none, for example above the horizon. */
  readonly positionAt: (at: Pixel, like: LayerPosition) => GeoPosition | null;
  /**
   * Height of a pixel above a position, measured on the vertical line through the position [m]; null: not visible. A view
   * from above has no such function.
   */
  readonly heightAt?: (at: Pixel, above: LayerPosition) => number | null;
  /** Pixel of the handle that changes a point's height; null: it has none. */
  readonly handleOf?: (point: LayerPoint) => Pixel | null;
}

/** The map as seen from above. */
export function onMap(view: MapView): LayerView {
  return { pixelOf: (at) => toPixel(view, at), positionAt: (at) => fromPixel(view, at) };
}

/** If more points than this are selected, only the first one shows its height and its handle. */
const MAX_HANDLES = 4;

/** The points that show their height and the handle that changes it. */
export function withHandles(points: readonly LayerPoint[]): readonly LayerPoint[] {
  const found = points.filter((point) => point.selected && point.height !== undefined);
  return found.length > MAX_HANDLES ? found.slice(0, 1) : found;
}

/** What a pointer is on: a point, or the handle that changes its height. */
export interface GrabTarget {
  readonly point: LayerPoint;
  readonly of: 'point' | 'handle';
}

/** The point or handle under a pointer; handles have priority over points, and points of the plan over midpoints. */
export function targetAt(view: LayerView, at: Pixel, points: readonly LayerPoint[], edgeDistance_px: number): GrabTarget | null {
  const handle = view.handleOf === undefined ? null : nearestWithin(view.handleOf, at, withHandles(points), edgeDistance_px);
  if (handle !== null) return { point: handle, of: 'handle' };
  const planPoints = points.filter((point) => point.mark !== 'middle');
  const midpoints = points.filter((point) => point.mark === 'middle');
  const point = nearestWithin(view.pixelOf, at, planPoints, edgeDistance_px) ?? nearestWithin(view.pixelOf, at, midpoints, edgeDistance_px * MIDDLE_REACH);
  return point === null ? null : { point, of: 'point' };
}

interface GrabbedPoint extends GrabTarget {
  began: Pixel;
  /** Offset from the pointer to the point, so that the point does not jump to the pointer. */
  offset: Pixel;
  /** Shift or Ctrl was pressed: the other points stay selected. */
  more: boolean;
  /** Id of the moving point; null: not moved yet. */
  moving: string | null;
  /** The point cannot move: the gesture is only a click. */
  fixed: boolean;
}

export class LayerGesture {
  private held: GrabbedPoint | null = null;

  constructor(private readonly editor: LayerEditor) {}

  /** Whether the point has moved. */
  get isMoving(): boolean {
    return this.held?.moving != null;
  }

  down(view: LayerView, at: Pixel, { point, of }: GrabTarget, more: boolean): void {
    const pixel = view.pixelOf(point) ?? at;
    this.held = { point, of, began: at, offset: { x: pixel.x - at.x, y: pixel.y - at.y }, more, moving: null, fixed: false };
  }

  /** Starts a move by keyboard. @returns false: the point cannot move. */
  grabByKeyboard(view: LayerView, point: LayerPoint): boolean {
    this.down(view, view.pixelOf(point) ?? { x: 0, y: 0 }, { point, of: 'point' }, false);
    this.begin();
    if (this.held?.moving === null) this.held = null;
    return this.held !== null;
  }

  move(view: LayerView, at: Pixel): void {
    const held = this.held;
    if (held === null || held.fixed) return;
    if (held.moving === null && Math.hypot(at.x - held.began.x, at.y - held.began.y) < CLICK_TOLERANCE_PX) return;
    if (held.moving === null) this.begin();
    if (held.moving === null) return;
    if (held.of === 'handle') this.raise(view, at, held);
    else {
      const to = view.positionAt({ x: at.x + held.offset.x, y: at.y + held.offset.y }, held.point);
      if (to !== null) this.editor.drag(held.moving, to);
    }
  }

  /** The pointer was released: a moved point is dropped, an unmoved one selected. A click on a handle has no effect. */
  up(): void {
    const held = this.held;
    this.held = null;
    if (held === null) return;
    if (held.moving !== null) this.editor.drop(true);
    else if (held.of === 'point') this.editor.pick(held.point.id, held.more);
  }

  /** Escape, or the system cancelled the pointer: all points go back. */
  cancel(): void {
    const moved = this.isMoving;
    this.held = null;
    if (moved) this.editor.drop(false);
  }

  private begin(): void {
    if (this.held === null) return;
    this.held.moving = this.editor.grab(this.held.point.id);
    this.held.fixed = this.held.moving === null;
  }

  private raise(view: LayerView, at: Pixel, { point, began }: GrabbedPoint): void {
    const [from_m, to_m] = [view.heightAt?.(began, point) ?? null, view.heightAt?.(at, point) ?? null];
    if (from_m !== null && to_m !== null) this.editor.raise(to_m - from_m);
  }
}
