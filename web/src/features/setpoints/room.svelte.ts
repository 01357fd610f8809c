/** Whether the offboard room is open, and what it is about to ask for: what map and 3D need of it. Small: always loaded. */

import type { Vector3 } from '../../live/topics';
import type { WireEvent } from '../../live/wire';
import type { Place } from '../stage/geo';

/** What is not sent yet, where the map can draw it. */
export interface ShownPreview {
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

class Room {
  open = $state(false);
  /** It shall open at its part for groups. */
  atGroups = $state(false);
  /** Not painted from: read once per frame by the map. */
  shown: ShownPreview | null = null;
  /** Null: none. Told to the 3D view whenever it changes. */
  scene = $state.raw<ScenePreview | null>(null);
  /** Set by the open room: a drag in 3D. */
  onDrag: ((event: WireEvent) => void) | null = null;

  toggle(): void {
    this.open = !this.open;
  }

  showGroups(): void {
    this.open = this.atGroups = true;
  }

  clear(): void {
    this.shown = null;
    this.scene = null;
  }
}

export const room = new Room();
