/** Describes who controls the gimbal. */

export interface ControlHolder {
  kind: 'server' | 'other' | 'vehicle' | 'nobody';
  text: string;
}

/** MAV_COMP_ID_AUTOPILOT1. */
const AUTOPILOT = 1;

/**
 * @param primaryControl (system id, component id) of the component in control, as the gimbal manager reports it.
 * @param isServerInControl whether this server is in control, as the server reports it.
 */
export function controlHolder(primaryControl: readonly [number, number] | null, isServerInControl: boolean): ControlHolder {
  if (primaryControl === null || (primaryControl[0] === 0 && primaryControl[1] === 0)) return { kind: 'nobody', text: 'not controlled' };
  if (isServerInControl) return { kind: 'server', text: 'controlled by this server' };
  if (primaryControl[1] === AUTOPILOT) return { kind: 'vehicle', text: 'controlled by the vehicle' };
  return { kind: 'other', text: `controlled by system ${primaryControl[0]}, component ${primaryControl[1]}` };
}
