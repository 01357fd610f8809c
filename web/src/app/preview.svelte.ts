/** What a room is about to send, for map and 3D view to draw. */

import type { Vector3 } from '../live/topics';
import type { WireEvent } from '../live/wire';
import type { Place } from '../vehicle/geo';

/** What is not sent yet, where the map can draw it. */
export interface MapPreview {
  vehicle: string;
  place: Place;
  yaw_ned_rad: number | null;
  label: string;
}

/** The same as the 3D view takes it. */
export interface ScenePreview {
  position_ned_m: Vector3;
  yaw_ned_rad: number | null;
  handles: boolean;
}

class Preview {
  /** Not painted from: the map reads it once per frame. */
  map: MapPreview | null = null;
  /** Null: none. The 3D view is told whenever it changes. */
  scene = $state.raw<ScenePreview | null>(null);
  /** Set by the open room: a handle was dragged in 3D. */
  onDrag: ((event: WireEvent) => void) | null = null;

  clear(): void {
    this.map = null;
    this.scene = null;
  }
}

export const preview = new Preview();
