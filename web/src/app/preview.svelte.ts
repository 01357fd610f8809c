/** The setpoint or dry run that a room shows on the map and in the 3D view before it is flown. */

import type { Vector3 } from '../live/topics';
import type { WireEvent } from '../live/wire';
import type { GeoPosition } from '../vehicle/geo';

/** The unsent setpoint as a point on the map. */
export interface MapPreview {
  vehicle: string;
  position: GeoPosition;
  yaw_ned_rad: number | null;
  label: string;
}

/** The same in the 3D view's format. */
export interface ScenePreview {
  position_ned_m: Vector3;
  yaw_ned_rad: number | null;
  handles: boolean;
}

/** One time of a dry run in the 3D view. */
export interface SceneDryRun {
  id: string;
  /** Null: only its path and corridor are shown. */
  t_s: number | null;
  /** The camera follows the simulated vehicle instead of the real one. */
  follow: boolean;
}

class Preview {
  /** Not reactive: the map reads it once per frame. */
  map: MapPreview | null = null;
  /** Null: no preview. Each change is sent to the 3D view. */
  scene = $state.raw<ScenePreview | null>(null);
  /** Null: no dry run is shown. */
  dryRun = $state.raw<SceneDryRun | null>(null);
  /** The dry run that the flight is compared with; shown if there is no other. */
  flight = $state.raw<SceneDryRun | null>(null);
  /** Set by the open room: called when a handle was dragged in 3D. */
  onDrag: ((event: WireEvent) => void) | null = null;

  clear(): void {
    this.map = null;
    this.scene = null;
  }
}

export const preview = new Preview();
