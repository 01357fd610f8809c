/**
 * Services that features provide to each other. Each service is provided by one feature; the other features get it by
 * its name.
 */

import type { Outcome } from '../api/client';
import type { Problem } from '../api/problems';
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
    /** Starts the stream with the given setpoint; null: with the vehicle's position. */
    start: (facts: VehicleFacts, streamStart: StreamStart | null) => Promise<Outcome<unknown>>;
  };
  replay: {
    /** Replays a recording of the server; the Fly view then shows it. */
    open: (recording: string) => Promise<void>;
    /** Name of the recording that is being opened. */
    openingName: () => string | null;
    /** Why the last recording could not be opened. */
    problem: () => Problem | null;
  };
  plots: {
    /** Shows plots of what arrives of a vehicle. @param panes their fields: `ATTITUDE:1.1/roll`. */
    showLive: (vehicle: string, name: string, panes: readonly (readonly string[])[]) => Promise<void>;
  };
  guided: {
    /** Opens the form of a guided command at a position on the map. */
    open: (kind: 'go' | 'orbit' | 'home' | 'heading', facts: VehicleFacts, place: GeoPosition & { readonly ground_amsl_m: number | null }) => void;
  };
  gimbal: {
    /** The vehicle's facts, with the gimbal that is selected on the gimbal card. The other functions need these facts. */
    withSelectedGimbal: (facts: VehicleFacts) => VehicleFacts;
    /** Whether this server controls the gimbal. */
    isServerInControl: (facts: VehicleFacts) => boolean;
    /** Whether yaw is locked relative to north. */
    yawLock: (facts: VehicleFacts) => boolean;
    roiOf: (facts: VehicleFacts) => Roi | null;
    /** Reads from the server who controls the gimbal, and the gimbal's ROI. */
    fetchControlAndRoi: (facts: VehicleFacts) => Promise<void>;
    /** Turns the camera at these rates until the next command; up and right are positive [deg/s]. */
    turnAt: (facts: VehicleFacts, pitch_deg_s: number, yaw_deg_s: number) => void;
  };
  /** The stage: the map and the 3D view, one of them large and the other an inset. */
  stage: {
    readonly sceneAvailable: boolean;
    readonly largeView: 'map' | 'scene';
    camera: Camera;
    /** Swaps map and 3D view. */
    swap: () => void;
    /** Makes the map large. */
    showMap: () => void;
    /** Fits positions into the part of the map that no panel covers. */
    showPositions: (positions: readonly GeoPosition[]) => void;
    /** Fits the positions of an opened plan into the map. If the 3D view is large and no vehicle is flying, the 3D view also fits the positions, once. */
    showPlan: (positions: readonly GeoPosition[]) => void;
    /** Called when more positions of the shown plan are known. The 3D view fits the plan again, unless a person has moved the camera. */
    refitPlan: () => void;
    /** Middle of the large view's part that no panel covers, and its distance to the part's edge; null: the 3D view shows no ground there. */
    visibleMiddle: () => { readonly at: GeoPosition; readonly edgeDistance_m: number } | null;
  };
}

const providedServices: Partial<Services> = {};

export function provide<K extends keyof Services>(name: K, service: Services[K]): void {
  providedServices[name] = service;
}

/**
 * The service that a feature provides.
 * @throws Error: no feature provides the service (a programming error).
 */
export function service<K extends keyof Services>(name: K): Services[K] {
  const found = providedServices[name];
  if (found === undefined) throw new Error(`No feature provides the service “${name}”: the feature’s register.ts must call provide().`);
  return found as Services[K];
}
