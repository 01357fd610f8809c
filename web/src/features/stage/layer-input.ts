/**
 * Handles pointer and keys on the editable layer before MapLibre or viser does, so that dragging a point does not
 * move the map or the camera.
 */

import { mapLayers } from '../../app/map-layers.svelte';
import type { Pixel } from '../../vehicle/geo';
import { LayerGesture, targetAt, type GrabTarget, type LayerView } from './layer-gesture';

/** Largest distance at which a mouse pointer grabs a point [px]. */
const GRAB_DISTANCE_PX = 14;
/** Largest distance at which a finger grabs a point [px]; larger, because a finger is less precise. */
const TOUCH_GRAB_DISTANCE_PX = 26;
/** Events that MapLibre handles as pans, clicks and zooms. */
const MAP_EVENTS = ['mousedown', 'touchstart', 'click', 'dblclick', 'contextmenu'] as const;

/** How the 3D view differs from the map. */
export interface SceneOptions {
  /** Further events that viser must not get while a point is dragged. */
  readonly stoppedEvents: readonly string[];
  /** Called with what is under the pointer while no button is pressed, to change the cursor. */
  readonly onhover: (target: GrabTarget | null) => void;
}

export class LayerInput {
  private gesture: LayerGesture | null = null;
  private pointerId: number | null = null;
  private pressedOnPoint = false;
  private movesByKeys = false;

  /** @param view the current view of the map or of the 3D view; null: not drawn, or an inset. */
  constructor(
    private readonly element: HTMLElement,
    private readonly view: () => LayerView | null,
    private readonly sceneOptions: SceneOptions | null = null,
  ) {}

  /** @returns a function that stops listening. */
  listen(): () => void {
    const { element } = this;
    const stopEvent = (event: Event): void => {
      if (!this.pressedOnPoint) return;
      event.stopPropagation();
      if (event.type === 'touchstart' || event.type === 'contextmenu') event.preventDefault();
    };
    const cancel = (): void => this.cancel();
    const stoppedEvents = [...MAP_EVENTS, ...(this.sceneOptions?.stoppedEvents ?? [])];
    element.addEventListener('pointerdown', this.onPointerDown, true);
    element.addEventListener('pointermove', this.onPointerMove);
    element.addEventListener('pointerup', this.onPointerUp);
    element.addEventListener('pointercancel', cancel);
    for (const type of stoppedEvents) element.addEventListener(type, stopEvent, { capture: true, passive: false });
    return () => {
      this.cancel();
      element.removeEventListener('pointerdown', this.onPointerDown, true);
      element.removeEventListener('pointermove', this.onPointerMove);
      element.removeEventListener('pointerup', this.onPointerUp);
      element.removeEventListener('pointercancel', cancel);
      for (const type of stoppedEvents) element.removeEventListener(type, stopEvent, { capture: true });
    };
  }

  /** Whether a point is being moved by keys. */
  get isMovingByKeys(): boolean {
    return this.movesByKeys;
  }

  /** Whether the last press of a pointer was on a point or handle of the layer; MapLibre or viser then does not get the pointer's events. */
  get isPressOnPoint(): boolean {
    return this.pressedOnPoint;
  }

  /** Whether a pointer is dragging a point. */
  get isDragging(): boolean {
    return this.pointerId !== null && this.gesture?.isMoving === true;
  }

  /** Handles Enter: grabs the point at the crosshair, or drops the grabbed point. @returns false: there is no point. */
  handleEnter(at: Pixel, addsToSelection: boolean): boolean {
    if (this.movesByKeys) {
      this.movesByKeys = false;
      this.gesture?.end();
      return true;
    }
    const [view, editedLayer] = [this.view(), mapLayers.editedLayer];
    // The crosshair moves in steps, so it needs the larger distance.
    const target = view === null || editedLayer === null ? null : targetAt(view, at, editedLayer.content.points, TOUCH_GRAB_DISTANCE_PX);
    if (view === null || editedLayer === null || target === null) return false;
    if (target.point.mark !== 'midpoint') editedLayer.editor.pick(target.point.id, addsToSelection);
    this.gesture = new LayerGesture(editedLayer.editor);
    this.movesByKeys = !addsToSelection && this.gesture.grabByKeyboard(view, target.point);
    return true;
  }

  /** Moves the grabbed point with the crosshair. */
  moveTo(at: Pixel): void {
    const view = this.view();
    if (this.movesByKeys && view !== null) this.gesture?.move(view, at);
  }

  cancel(): void {
    this.movesByKeys = false;
    this.pointerId = null;
    this.gesture?.cancel();
  }

  private pixelOf(event: PointerEvent): Pixel {
    const box = this.element.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }

  private targetOf(view: LayerView, event: PointerEvent): GrabTarget | null {
    const points = mapLayers.editedLayer?.content.points ?? [];
    return targetAt(view, this.pixelOf(event), points, event.pointerType === 'touch' ? TOUCH_GRAB_DISTANCE_PX : GRAB_DISTANCE_PX);
  }

  private readonly onPointerDown = (event: PointerEvent): void => {
    if (this.pointerId !== null) return; // a second finger has no effect
    this.pressedOnPoint = false;
    if (this.movesByKeys) this.cancel();
    const [view, editedLayer] = [this.view(), mapLayers.editedLayer];
    if (view === null || editedLayer === null || event.button !== 0) return;
    const target = this.targetOf(view, event);
    if (target === null) return;
    this.pressedOnPoint = true;
    this.pointerId = event.pointerId;
    this.element.setPointerCapture(event.pointerId);
    this.gesture = new LayerGesture(editedLayer.editor);
    this.gesture.start(view, this.pixelOf(event), target, event.shiftKey || event.ctrlKey || event.metaKey);
  };

  private readonly onPointerMove = (event: PointerEvent): void => {
    const view = this.view();
    if (view === null) return;
    if (event.pointerId === this.pointerId) this.gesture?.move(view, this.pixelOf(event));
    else if (this.pointerId === null && event.buttons === 0) this.sceneOptions?.onhover(this.targetOf(view, event));
  };

  private readonly onPointerUp = (event: PointerEvent): void => {
    if (event.pointerId !== this.pointerId) return;
    this.pointerId = null;
    this.gesture?.end();
  };
}
