/**
 * Handles pointer and keys on the editable layer before MapLibre does, so that dragging a point does not pan the map.
 */

import { mapLayers } from '../../app/map-layers.svelte';
import type { MapView, Pixel } from '../../vehicle/geo';
import { LayerGesture, pointAt } from './layer-gesture';

const REACH_PX = 14;
/** Larger for touch, because a finger is less precise. */
const TOUCH_REACH_PX = 26;
/** Events from which MapLibre makes pans, clicks and zooms. */
const MAP_EVENTS = ['mousedown', 'touchstart', 'click', 'dblclick', 'contextmenu'] as const;

export class LayerInput {
  private gesture: LayerGesture | null = null;
  private pointer: number | null = null;
  /** The layer handles the pointer that was last pressed; MapLibre gets none of its events. */
  private taken = false;
  private byKeys = false;

  /** @param view what the map shows now; null: no map, or it is an inset. */
  constructor(
    private readonly holder: HTMLElement,
    private readonly view: () => MapView | null,
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
    holder.addEventListener('pointerdown', this.down, true);
    holder.addEventListener('pointermove', this.move);
    holder.addEventListener('pointerup', this.up);
    holder.addEventListener('pointercancel', cancel);
    for (const type of MAP_EVENTS) holder.addEventListener(type, stop, { capture: true, passive: false });
    return () => {
      this.cancel();
      holder.removeEventListener('pointerdown', this.down, true);
      holder.removeEventListener('pointermove', this.move);
      holder.removeEventListener('pointerup', this.up);
      holder.removeEventListener('pointercancel', cancel);
      for (const type of MAP_EVENTS) holder.removeEventListener(type, stop, { capture: true });
    };
  }

  /** Whether a point is being moved by keys. */
  get holdsByKeys(): boolean {
    return this.byKeys;
  }

  /** Enter at the crosshair: grabs the point there, or drops the grabbed one. @returns false: there is no point. */
  enter(at: Pixel, more: boolean): boolean {
    if (this.byKeys) {
      this.byKeys = false;
      this.gesture?.up();
      return true;
    }
    const [view, edited] = [this.view(), mapLayers.edited];
    const point = view === null || edited === null ? null : pointAt(view, at, edited.picture.points, TOUCH_REACH_PX);
    if (view === null || edited === null || point === null) return false;
    if (point.mark !== 'middle') edited.editor.pick(point.id, more);
    this.gesture = new LayerGesture(edited.editor);
    this.byKeys = !more && this.gesture.grabByKeyboard(view, point);
    return true;
  }

  /** The crosshair moved: moves the grabbed point. */
  moveTo(at: Pixel): void {
    const view = this.view();
    if (this.byKeys && view !== null) this.gesture?.move(view, at);
  }

  cancel(): void {
    this.byKeys = false;
    this.pointer = null;
    this.gesture?.cancel();
  }

  private at(event: PointerEvent): Pixel {
    const box = this.holder.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }

  private readonly down = (event: PointerEvent): void => {
    if (this.pointer !== null) return; // a second finger has no effect
    this.taken = false;
    if (this.byKeys) this.cancel();
    const [view, edited] = [this.view(), mapLayers.edited];
    if (view === null || edited === null || event.button !== 0) return;
    const at = this.at(event);
    const point = pointAt(view, at, edited.picture.points, event.pointerType === 'touch' ? TOUCH_REACH_PX : REACH_PX);
    if (point === null) return;
    this.taken = true;
    this.pointer = event.pointerId;
    this.holder.setPointerCapture(event.pointerId);
    this.gesture = new LayerGesture(edited.editor);
    this.gesture.down(view, at, point, event.shiftKey || event.ctrlKey || event.metaKey);
  };

  private readonly move = (event: PointerEvent): void => {
    const view = this.view();
    if (event.pointerId === this.pointer && view !== null) this.gesture?.move(view, this.at(event));
  };

  private readonly up = (event: PointerEvent): void => {
    if (event.pointerId !== this.pointer) return;
    this.pointer = null;
    this.gesture?.up();
  };
}
