/**
 * Services that features provide to each other. The interfaces are here; one feature provides each service, others
 * get it by name.
 */

import type { Outcome } from '../api/client';
import type { components } from '../api/schema';
import type { StreamStart } from '../vehicle/setpoint';
import type { GeoPosition } from '../vehicle/geo';
import type { VehicleFacts } from '../vehicle/facts';

/** Cameras of the 3D view. */
export const CAMERAS = ['chase', 'free', 'gimbal', 'top'] as const;
export type Camera = (typeof CAMERAS)[number];

export type Roi = components['schemas']['Roi'];

export interface Services {
  offboard: {
    /** Starts the stream with the given setpoint, else at the vehicle's position. */
    start: (facts: VehicleFacts, streamStart: StreamStart | null) => Promise<Outcome<unknown>>;
  };
  gimbal: {
    /** The facts with the gimbal that is selected on the vehicle's card; the other functions are about this one. */
    selected: (facts: VehicleFacts) => VehicleFacts;
    /** Whether this server controls the gimbal. */
    inControl: (facts: VehicleFacts) => boolean;
    /** Whether yaw is held relative to north. */
    lock: (facts: VehicleFacts) => boolean;
    roiOf: (facts: VehicleFacts) => Roi | null;
    /** Reads from the server who controls the gimbal, and its ROI. */
    fetchHolder: (facts: VehicleFacts) => Promise<void>;
  };
  stage: {
    readonly sceneAvailable: boolean;
    /** Whether map or 3D view is large. */
    readonly main: 'map' | 'scene';
    camera: Camera;
    /** Swaps map and 3D view. */
    swap: () => void;
    /** Makes the map large. */
    showMap: () => void;
    /** Fits positions into the part of the map that no panel covers. */
    showPositions: (positions: readonly GeoPosition[]) => void;
    /** The same for a plan that was opened; also the 3D view shows it, once, when it is large and no vehicle flies. */
    showPlan: (positions: readonly GeoPosition[]) => void;
    /** The shown plan is known completely now: the 3D view shows it again, unless a person has moved its camera. */
    growPlan: () => void;
    /** The middle of the part of the large view that no panel covers, and the distance to its edge; null: no ground is there. */
    visibleMiddle: () => { readonly at: GeoPosition; readonly reach_m: number } | null;
  };
}

const provided: Partial<Services> = {};

export function provide<K extends keyof Services>(name: K, service: Services[K]): void {
  provided[name] = service;
}

/**
 * @throws Error: no feature provides it (a programming error).
 */
export function service<K extends keyof Services>(name: K): Services[K] {
  const found = provided[name];
  if (found === undefined) throw new Error(`No feature provides the service “${name}”: its register.ts calls provide().`);
  return found as Services[K];
}
