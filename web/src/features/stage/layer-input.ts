/**
 * Handles pointer and keys on the editable layer before MapLibre or viser does, so that dragging a point does not
 * move the map or the camera.
 */

import { mapLayers } from '../../app/map-layers.svelte';
import type { Pixel } from '../../vehicle/geo';
import { LayerGesture, targetAt, type GrabTarget, type LayerView } from './layer-gesture';

/** Distance within which a pointer reaches a point [px]. */
const REACH_PX = 14;
/** Distance within which a finger reaches a point [px]; larger, because a finger is less precise. */
const TOUCH_REACH_PX = 26;
/** Events from which MapLibre makes pans, clicks and zooms. */
const MAP_EVENTS = ['mousedown', 'touchstart', 'click', 'dblclick', 'contextmenu'] as const;

/** How the 3D view differs from the map. */
export interface SceneOptions {
  /** Further events that the view below must not get while a point is dragged. */
  readonly stops: readonly string[];
  /** Called with what is under an unpressed pointer, to change the cursor. */
  readonly onhover: (target: GrabTarget | null) => void;
}

export class LayerInput {
  private gesture: LayerGesture | null = null;
  private pointer: number | null = null;
  private taken = false;
  private movesByKeys = false;

  /** @param view the current view of the map or of the 3D view; null: not drawn, or an inset. */
  constructor(
    private readonly holder: HTMLElement,
    private readonly view: () => LayerView | null,
    private readonly inScene: SceneOptions | null = null,
  ) {}

  /** @returns a function that stops listening. */
  listen(): () => void {
    const { holder } = this;
    const stop = (event: Event): void => {
      if (!this.taken) return;
      event.stopPropagation();
      if (event.type === 'touchstart' || event.type === 'contextmenu') event.preventDefault();
    };
    const cancel = (): void => this.cancel();
    const stopped = [...MAP_EVENTS, ...(this.inScene?.stops ?? [])];
    holder.addEventListener('pointerdown', this.down, true);
    holder.addEventListener('pointermove', this.move);
    holder.addEventListener('pointerup', this.up);
    holder.addEventListener('pointercancel', cancel);
    for (const type of stopped) holder.addEventListener(type, stop, { capture: true, passive: false });
    return () => {
      this.cancel();
      holder.removeEventListener('pointerdown', this.down, true);
      holder.removeEventListener('pointermove', this.move);
      holder.removeEventListener('pointerup', this.up);
      holder.removeEventListener('pointercancel', cancel);
      for (const type of stopped) holder.removeEventListener(type, stop, { capture: true });
    };
  }

  /** Whether a point is being moved by keys. */
  get isMovingByKeys(): boolean {
    return this.movesByKeys;
  }

  /** Whether the last press of a pointer was on the layer; the view below then does not get the pointer's events. */
  get isTaken(): boolean {
    return this.taken;
  }

  /** Whether a pointer is dragging a point. */
  get isDragging(): boolean {
    return this.pointer !== null && this.gesture?.isMoving === true;
  }

  /** Handles Enter: grabs the point at the crosshair, or drops the grabbed point. @returns false: there is no point. */
  enter(at: Pixel, more: boolean): boolean {
    if (this.movesByKeys) {
      this.movesByKeys = false;
      this.gesture?.up();
      return true;
    }
    const [view, edited] = [this.view(), mapLayers.edited];
    const target = view === null || edited === null ? null : targetAt(view, at, edited.picture.points, TOUCH_REACH_PX);
    if (view === null || edited === null || target === null) return false;
    if (target.point.mark !== 'midpoint') edited.editor.pick(target.point.id, more);
    this.gesture = new LayerGesture(edited.editor);
    this.movesByKeys = !more && this.gesture.grabByKeyboard(view, target.point);
    return true;
  }

  /** Moves the grabbed point with the crosshair. */
  moveTo(at: Pixel): void {
    const view = this.view();
    if (this.movesByKeys && view !== null) this.gesture?.move(view, at);
  }

  cancel(): void {
    this.movesByKeys = false;
    this.pointer = null;
    this.gesture?.cancel();
  }

  private at(event: PointerEvent): Pixel {
    const box = this.holder.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }

  private targetOf(view: LayerView, event: PointerEvent): GrabTarget | null {
    const points = mapLayers.edited?.picture.points ?? [];
    return targetAt(view, this.at(event), points, event.pointerType === 'touch' ? TOUCH_REACH_PX : REACH_PX);
  }

  private readonly down = (event: PointerEvent): void => {
    if (this.pointer !== null) return; // a second finger has no effect
    this.taken = false;
    if (this.movesByKeys) this.cancel();
    const [view, edited] = [this.view(), mapLayers.edited];
    if (view === null || edited === null || event.button !== 0) return;
    const target = this.targetOf(view, event);
    if (target === null) return;
    this.taken = true;
    this.pointer = event.pointerId;
    this.holder.setPointerCapture(event.pointerId);
    this.gesture = new LayerGesture(edited.editor);
    this.gesture.down(view, this.at(event), target, event.shiftKey || event.ctrlKey || event.metaKey);
  };

  private readonly move = (event: PointerEvent): void => {
    const view = this.view();
    if (view === null) return;
    if (event.pointerId === this.pointer) this.gesture?.move(view, this.at(event));
    else if (this.pointer === null && event.buttons === 0) this.inScene?.onhover(this.targetOf(view, event));
  };

  private readonly up = (event: PointerEvent): void => {
    if (event.pointerId !== this.pointer) return;
    this.pointer = null;
    this.gesture?.up();
  };
}
