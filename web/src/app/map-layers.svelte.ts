/**
 * Layers that features show on the large map and in the 3D view: points, lines, areas and solids, which may be
 * editable. The map and the 3D view draw the layers and handle the pointer.
 */

import type { GeoPosition } from '../vehicle/geo';

/**
 * A colour by its meaning: planned (`target`), geofence (`caution`), forbidden (`danger`), actual, neutral (`text2`); of the second
 * to fourth of several vehicles (`id2` to `id4`).
 */
export type Tone = 'target' | 'caution' | 'danger' | 'actual' | 'text2' | 'id2' | 'id3' | 'id4';

/** A position of a layer. */
export interface LayerPosition extends GeoPosition {
  /** Altitude for the 3D view; missing: on the ground. */
  readonly alt_amsl_m?: number;
}

export interface LayerPoint extends LayerPosition {
  /** Unique within its layer. */
  readonly id: string;
  /**
   * `midpoint`: midpoint of a leg, where a drag inserts a point; `corner`: corner of an area; `cross`: a position to look at;
   * `vehicle`: a simulated vehicle.
   */
  readonly mark: 'disc' | 'corner' | 'midpoint' | 'cross' | 'home' | 'vehicle';
  readonly tone: Tone;
  /** Text on the point; empty for none. */
  readonly text: string;
  readonly selected: boolean;
  /** Drawn weakly: already flown. */
  readonly faded?: boolean;
  /** Heading of a simulated vehicle, clockwise from north. */
  readonly yaw_deg?: number;
  /** Text of the altitude; set only if the editor can change the altitude of this point. */
  readonly altitudeText?: string;
}

export interface LayerLine {
  readonly positions: readonly LayerPosition[];
  readonly tone: Tone;
  /** `dotted`: a path that the autopilot chooses; `dashed`: a limit. */
  readonly style: 'solid' | 'dotted' | 'dashed';
  /** Drawn weakly: already flown. */
  readonly faded?: boolean;
}

export interface LayerArea {
  readonly ring: readonly GeoPosition[];
  readonly tone: Tone;
}

/** A vertical prism from the ground to `top_amsl_m`, for the 3D view. The map shows a `LayerArea` instead. */
export interface LayerSolid {
  readonly ring: readonly GeoPosition[];
  readonly top_amsl_m: number;
  readonly tone: Tone;
}

/** What a layer shows. */
export interface LayerContent {
  readonly points: readonly LayerPoint[];
  readonly lines: readonly LayerLine[];
  readonly areas: readonly LayerArea[];
  readonly solids?: readonly LayerSolid[];
  /**
   * A position on the ground. The 3D view draws flat ground at the altitude of this position. Missing: the 3D view does
   * not show the layer.
   */
  readonly ground?: Required<LayerPosition>;
}

/** Handles a person's gestures on the layer. The argument `id` is a point's id. */
export interface LayerEditor {
  /** The point was clicked, or Enter was pressed on it. @param keepsOthers Shift or Ctrl was pressed: the other points stay selected. */
  pick: (id: string, keepsOthers: boolean) => void;
  /** A drag begins. @returns the id of the point that moves (for a `midpoint`, the inserted point); null: the point cannot move. */
  grab: (id: string) => string | null;
  /** Moves the grabbed point and all other selected points. */
  drag: (id: string, to: GeoPosition) => void;
  /** Raises the grabbed point and all other selected points above their altitudes at the start of the drag; negative: lowers them. */
  raise: (by_m: number) => void;
  /** The drag has ended. @param keep false: all points return to their positions before the drag. */
  drop: (keep: boolean) => void;
  /** A click on the ground. @returns false: the layer does not use the click. */
  press: (at: GeoPosition) => boolean;
  /** Deletes the selection. @returns false: nothing is selected. */
  remove: () => boolean;
}

export interface MapLayer {
  readonly id: string;
  /** The layer's present content, read reactively; null: the layer shows nothing now. */
  readonly content: () => LayerContent | null;
  /** Missing: the layer cannot be edited. */
  readonly editor?: LayerEditor;
  /** A click on the map. @param within_m what a person can hit there. @returns false: the layer does not use the click. */
  readonly press?: (at: GeoPosition, within_m: number) => boolean;
}

class MapLayers {
  private layers = $state.raw<readonly MapLayer[]>([]);

  /** Adds a layer on top of the other layers. @returns a function that removes the layer. */
  show(layer: MapLayer): () => void {
    this.layers = [...this.layers, layer];
    return () => (this.layers = this.layers.filter((other) => other !== layer));
  }

  /** Gives a click on the map to the topmost layer that uses it. @returns whether one does. */
  press(at: GeoPosition, within_m: number): boolean {
    return [...this.layers].reverse().some((layer) => layer.press?.(at, within_m) === true);
  }

  readonly contents: readonly LayerContent[] = $derived(this.layers.flatMap((layer) => layer.content() ?? []));

  /** Content and editor of the topmost editable layer. This editor handles the gestures. */
  readonly editedLayer: { readonly content: LayerContent; readonly editor: LayerEditor } | null = $derived.by(() => {
    for (const layer of [...this.layers].reverse()) {
      const content = layer.editor === undefined ? null : layer.content();
      if (content !== null && layer.editor !== undefined) return { content, editor: layer.editor };
    }
    return null;
  });
}

export const mapLayers = new MapLayers();
