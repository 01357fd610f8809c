/**
 * One gesture on an editable layer, on the map or in the 3D view: a click selects a point, a drag moves a point. On the
 * map, arrow keys can also move a point. Depends on pixels, positions and the editor, not on the page.
 */

import type { LayerEditor, LayerPoint, LayerPosition } from '../../app/map-layers.svelte';
import { fromPixel, nearestWithin, toPixel, type GeoPosition, type MapView, type Pixel } from '../../vehicle/geo';

/** If the pointer moves less than this, the gesture is a click [px]. */
const CLICK_TOLERANCE_PX = 5;
/** The largest distance at which a pointer grabs a midpoint, as a fraction of the distance for other points. */
const MIDPOINT_GRAB_FRACTION = 0.7;

/** Converts between positions and pixels of the map or of the 3D view. */
export interface LayerView {
  /** Null: not visible. */
  readonly pixelOf: (at: LayerPosition) => Pixel | null;
  /** The position at a pixel with the altitude of `reference`; null: none, for example above the horizon. */
  readonly positionAt: (at: Pixel, reference: LayerPosition) => GeoPosition | null;
  /**
   * Height of a pixel above `position`, on the vertical line through `position` [m]; null: not visible. A view
   * from above does not have this function.
   */
  readonly heightAt?: (at: Pixel, position: LayerPosition) => number | null;
  /** Pixel of the handle that changes a point's altitude; null: the point has no handle. */
  readonly handleOf?: (point: LayerPoint) => Pixel | null;
}

/** The map as seen from above. */
export function viewFromAbove(view: MapView): LayerView {
  return { pixelOf: (at) => toPixel(view, at), positionAt: (at) => fromPixel(view, at) };
}

/** If more points than this are selected, only the first point has a handle. */
const MAX_HANDLES = 4;

/** The points that show their altitude and a handle to change it. */
export function withHandles(points: readonly LayerPoint[]): readonly LayerPoint[] {
  const raisablePoints = points.filter((point) => point.selected && point.altitudeText !== undefined);
  return raisablePoints.length > MAX_HANDLES ? raisablePoints.slice(0, 1) : raisablePoints;
}

/** What is under the pointer: a point, or the handle that changes the point's altitude. */
export interface GrabTarget {
  readonly point: LayerPoint;
  readonly part: 'point' | 'handle';
}

/** The point or handle under a pointer; handles have priority over points, and points of the plan over midpoints. */
export function targetAt(view: LayerView, at: Pixel, points: readonly LayerPoint[], grabDistance_px: number): GrabTarget | null {
  const handle = view.handleOf === undefined ? null : nearestWithin(view.handleOf, at, withHandles(points), grabDistance_px);
  if (handle !== null) return { point: handle, part: 'handle' };
  const planPoints = points.filter((point) => point.mark !== 'midpoint');
  const midpoints = points.filter((point) => point.mark === 'midpoint');
  const point =
    nearestWithin(view.pixelOf, at, planPoints, grabDistance_px) ?? nearestWithin(view.pixelOf, at, midpoints, grabDistance_px * MIDPOINT_GRAB_FRACTION);
  return point === null ? null : { point, part: 'point' };
}

/**
 * What a click on the ground does: the edited layer uses it, or the page opens the menu for the position, or nothing.
 * @param isRight a right click, or a long press on a touch screen: only for the menu, so that it changes no plan.
 * @param editor the editor of the edited layer; null: no layer is edited.
 */
export function clickOnGround(at: GeoPosition, isRight: boolean, editor: LayerEditor | null): 'used' | 'menu' | 'nothing' {
  if (editor === null) return 'menu';
  return !isRight && editor.press(at) ? 'used' : 'nothing';
}

interface GrabbedPoint extends GrabTarget {
  /** Pixel at which the gesture started. */
  startPixel: Pixel;
  /** Offset from the pointer to the point, so that the point does not jump to the pointer. */
  offset: Pixel;
  /** Shift or Ctrl was pressed: the other points stay selected. */
  addsToSelection: boolean;
  /** Id of the point that is being moved; null: not moved yet. */
  movedId: string | null;
  /** The editor cannot move the point, so the gesture can only be a click. */
  isFixed: boolean;
}

export class LayerGesture {
  private grabbedPoint: GrabbedPoint | null = null;

  constructor(private readonly editor: LayerEditor) {}

  /** Whether a point is being moved. */
  get isMoving(): boolean {
    return this.grabbedPoint?.movedId != null;
  }

  start(view: LayerView, at: Pixel, { point, part }: GrabTarget, addsToSelection: boolean): void {
    const pixel = view.pixelOf(point) ?? at;
    this.grabbedPoint = { point, part, startPixel: at, offset: { x: pixel.x - at.x, y: pixel.y - at.y }, addsToSelection, movedId: null, isFixed: false };
  }

  /** Starts a move by keyboard. @returns false: the point cannot move. */
  grabByKeyboard(view: LayerView, point: LayerPoint): boolean {
    this.start(view, view.pixelOf(point) ?? { x: 0, y: 0 }, { point, part: 'point' }, false);
    this.beginMove();
    if (this.grabbedPoint?.movedId === null) this.grabbedPoint = null;
    return this.grabbedPoint !== null;
  }

  move(view: LayerView, at: Pixel): void {
    const grabbedPoint = this.grabbedPoint;
    if (grabbedPoint === null || grabbedPoint.isFixed) return;
    if (grabbedPoint.movedId === null && Math.hypot(at.x - grabbedPoint.startPixel.x, at.y - grabbedPoint.startPixel.y) < CLICK_TOLERANCE_PX) return;
    if (grabbedPoint.movedId === null) this.beginMove();
    if (grabbedPoint.movedId === null) return;
    if (grabbedPoint.part === 'handle') this.moveHandle(view, at, grabbedPoint);
    else {
      const to = view.positionAt({ x: at.x + grabbedPoint.offset.x, y: at.y + grabbedPoint.offset.y }, grabbedPoint.point);
      if (to !== null) this.editor.drag(grabbedPoint.movedId, to);
    }
  }

  /**
   * Handles the release of the pointer, or Enter: drops a moved point, or selects the clicked point. A click on a handle
   * has no effect.
   */
  end(): void {
    const grabbedPoint = this.grabbedPoint;
    this.grabbedPoint = null;
    if (grabbedPoint === null) return;
    if (grabbedPoint.movedId !== null)
      this.editor.drop(true); // keeps the new positions
    else if (grabbedPoint.part === 'point') this.editor.pick(grabbedPoint.point.id, grabbedPoint.addsToSelection);
  }

  /** Ends the gesture (Escape, or a cancelled pointer) and moves all points back. */
  cancel(): void {
    const wasMoving = this.isMoving;
    this.grabbedPoint = null;
    if (wasMoving) this.editor.drop(false); // restores the old positions
  }

  private beginMove(): void {
    if (this.grabbedPoint === null) return;
    this.grabbedPoint.movedId = this.editor.grab(this.grabbedPoint.point.id);
    this.grabbedPoint.isFixed = this.grabbedPoint.movedId === null;
  }

  private moveHandle(view: LayerView, at: Pixel, { point, startPixel }: GrabbedPoint): void {
    const [from_m, to_m] = [view.heightAt?.(startPixel, point) ?? null, view.heightAt?.(at, point) ?? null];
    if (from_m !== null && to_m !== null) this.editor.raise(to_m - from_m);
  }
}
