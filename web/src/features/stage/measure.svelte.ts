/** A distance that is being measured on the map: clicks add points, nothing is sent. */

import type { LayerEditor } from '../../app/map-layers.svelte';
import type { GeoPosition } from '../../vehicle/geo';
import { measured, measureLayer } from './measure';

export const MAX_MEASURED_POINTS = 100;
const MIN_CORNERS = 3;

export class Measurement implements LayerEditor {
  points = $state.raw<readonly GeoPosition[]>([]);
  closed = $state(false);
  private selected = $state<number | null>(null);
  private beforeDrag: readonly GeoPosition[] | null = null;

  readonly result = $derived(measured(this.points, this.closed));
  readonly content = $derived.by(() => measureLayer(this.points, this.closed, this.selected));
  readonly canClose: boolean = $derived(this.points.length >= MIN_CORNERS);
  readonly isFull: boolean = $derived(this.points.length >= MAX_MEASURED_POINTS);

  clear(): void {
    this.points = [];
    this.closed = false;
    this.selected = null;
  }

  setClosed(closed: boolean): void {
    this.closed = closed && this.canClose;
  }

  press({ lat_deg, lon_deg }: GeoPosition): boolean {
    if (this.isFull) return true;
    this.points = [...this.points, { lat_deg, lon_deg }];
    this.selected = this.points.length - 1;
    return true;
  }

  /** A click on the first point closes the area. */
  pick(id: string): void {
    const index = indexOf(id);
    if (index === 0 && this.canClose && this.selected === this.points.length - 1) this.closed = true;
    this.selected = index;
  }

  grab(id: string): string {
    this.beforeDrag = this.points;
    this.selected = indexOf(id);
    return id;
  }

  drag(id: string, { lat_deg, lon_deg }: GeoPosition): void {
    const moved = indexOf(id);
    this.points = this.points.map((point, index) => (index === moved ? { lat_deg, lon_deg } : point));
  }

  /** Does nothing: the points have no altitude. */
  raise(): void {}

  drop(keep: boolean): void {
    if (!keep && this.beforeDrag !== null) this.points = this.beforeDrag;
    this.beforeDrag = null;
  }

  /** Removes the selected point, or else the last one. */
  remove(): boolean {
    if (this.points.length === 0) return false;
    const removed = this.selected ?? this.points.length - 1;
    this.points = this.points.filter((_, index) => index !== removed);
    this.selected = this.points.length === 0 ? null : Math.max(0, removed - 1);
    this.closed = this.closed && this.canClose;
    return true;
  }
}

const indexOf = (id: string): number => Number(id.replace('measure:', ''));
