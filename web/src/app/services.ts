/** What one feature does for another: the contract stands here, the feature provides it, others ask for it by name. */

import type { Outcome } from '../api/client';
import type { components } from '../api/schema';
import type { StartWish } from '../vehicle/setpoint';
import type { Place } from '../vehicle/geo';
import type { VehicleFacts } from '../vehicle/facts';

/** Cameras of the 3D view. */
export const CAMERAS = ['chase', 'free', 'gimbal', 'top'] as const;
export type Camera = (typeof CAMERAS)[number];

export type Roi = components['schemas']['Roi'];

export interface Services {
  offboard: {
    /** Starts the stream with what is wished, else where the vehicle is. */
    start: (facts: VehicleFacts, wish: StartWish | null) => Promise<Outcome<unknown>>;
  };
  gimbal: {
    /** Whether this server controls the gimbal. */
    inControl: (facts: VehicleFacts) => boolean;
    /** Whether yaw is held relative to north. */
    lock: (facts: VehicleFacts) => boolean;
    roiOf: (facts: VehicleFacts) => Roi | null;
    /** Asks the server anew who controls it and what it looks at. */
    askHolder: (facts: VehicleFacts) => Promise<void>;
  };
  stage: {
    readonly sceneIsThere: boolean;
    /** Which of the two fills the stage. */
    readonly main: 'map' | 'scene';
    camera: Camera;
    /** Makes the other one large. */
    swap: () => void;
    /** Makes the map large. */
    showMap: () => void;
    /** Puts places into what panels leave free of the map. */
    showPlaces: (places: readonly Place[]) => void;
  };
}

const provided: Partial<Services> = {};

export function provide<K extends keyof Services>(name: K, service: Services[K]): void {
  provided[name] = service;
}

/**
 * @throws Error: no feature provides it (a mistake of the build, not of a person).
 */
export function service<K extends keyof Services>(name: K): Services[K] {
  const found = provided[name];
  if (found === undefined) throw new Error(`No feature provides the service “${name}”: its register.ts calls provide().`);
  return found as Services[K];
}
