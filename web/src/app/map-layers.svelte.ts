/** Map layers that features show on the large map: points, lines and areas, editable if wanted. The stage draws and picks them. */

import type { Place } from '../vehicle/geo';

/** A colour by its meaning: planned, geofence, forbidden, is, neither. */
export type Tone = 'target' | 'caution' | 'danger' | 'actual' | 'text2';

export interface LayerPoint extends Place {
  /** Unique within its layer. */
  readonly id: string;
  /** `middle`: between two points, inserts one; `corner`: of an area; `cross`: looked at, not flown to; `ghost`: a vehicle that is not there. */
  readonly mark: 'disc' | 'corner' | 'middle' | 'cross' | 'home' | 'ghost';
  readonly tone: Tone;
  /** Text in the disc; empty for none. */
  readonly text: string;
  readonly selected: boolean;
  /** Of a ghost: where its nose points, clockwise from north [deg]. */
  readonly yaw_deg?: number;
}

export interface LayerLine {
  readonly places: readonly Place[];
  readonly tone: Tone;
  /** `dotted`: the autopilot's own way; `dashed`: a limit. */
  readonly style: 'solid' | 'dotted' | 'dashed';
}

export interface LayerArea {
  readonly ring: readonly Place[];
  readonly tone: Tone;
}

export interface LayerPicture {
  readonly points: readonly LayerPoint[];
  readonly lines: readonly LayerLine[];
  readonly areas: readonly LayerArea[];
}

/** Handles a person's gestures on the layer. Points are named by their `id`. */
export interface LayerEditor {
  /** Clicked, or Enter on it. @param more with Shift or Ctrl: the others stay selected. */
  pick: (id: string, more: boolean) => void;
  /** A drag begins. @returns the point that moves: another one where a `middle` inserts it; null: it does not move. */
  grab: (id: string) => string | null;
  /** The grabbed point, and whatever is selected with it, moves. */
  drag: (id: string, to: Place) => void;
  /** The drag is over. @param keep false: everything goes back to where it was. */
  drop: (keep: boolean) => void;
  /** A click on the ground. @returns false: not for this layer. */
  press: (at: Place) => boolean;
  /** Deletes what is selected. @returns false: nothing is. */
  remove: () => boolean;
}

export interface MapLayer {
  readonly id: string;
  /** Null: nothing to show now. Read reactively. */
  readonly picture: () => LayerPicture | null;
  /** None: for looking at only. */
  readonly editor?: LayerEditor;
}

class MapLayers {
  private layers = $state.raw<readonly MapLayer[]>([]);

  /** Adds a layer on top of the others. @returns a function that removes it. */
  show(layer: MapLayer): () => void {
    this.layers = [...this.layers, layer];
    return () => (this.layers = this.layers.filter((one) => one !== layer));
  }

  readonly pictures: readonly LayerPicture[] = $derived(this.layers.flatMap((layer) => layer.picture() ?? []));

  /** The topmost layer that can be edited, with what it shows: gestures are its own. */
  readonly edited: { readonly picture: LayerPicture; readonly editor: LayerEditor } | null = $derived.by(() => {
    for (const layer of [...this.layers].reverse()) {
      const picture = layer.editor === undefined ? null : layer.picture();
      if (picture !== null && layer.editor !== undefined) return { picture, editor: layer.editor };
    }
    return null;
  });
}

export const mapLayers = new MapLayers();
