/** The unsent setpoint or the dry run that a room shows on the map and in the 3D view. */

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

/** The unsent setpoint in the 3D view's format. */
export interface ScenePreview {
  position_ned_m: Vector3;
  yaw_ned_rad: number | null;
  /** Whether the 3D view shows the handles that drag the setpoint. */
  handles: boolean;
}

/** A dry run in the 3D view, shown at the time `t_s`. */
export interface SceneDryRun {
  id: string;
  /** Time since the start of the dry run; null: the 3D view shows only the path and the corridor. */
  t_s: number | null;
  /** The camera follows the simulated vehicle instead of the real vehicle. */
  follow: boolean;
}

class StagePreview {
  /** The setpoint on the map; null: none. Not reactive, because the map reads this value once per animation frame. */
  map: MapPreview | null = null;
  /** The setpoint in the 3D view; null: none. Each change is sent to the 3D view. */
  scene = $state.raw<ScenePreview | null>(null);
  /** Null: no dry run is shown. */
  dryRun = $state.raw<SceneDryRun | null>(null);
  /** The dry run that the 3D view compares with the flight; shown while `dryRun` is null. */
  comparedDryRun = $state.raw<SceneDryRun | null>(null);
  /** Called when a person has dragged a handle in the 3D view; the open room sets this function. */
  onDrag: ((event: WireEvent) => void) | null = null;

  clearSetpoint(): void {
    this.map = null;
    this.scene = null;
  }
}

export const preview = new StagePreview();
