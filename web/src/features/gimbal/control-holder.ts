/** Describes who controls the gimbal. */

export interface ControlHolder {
  controller: 'server' | 'other' | 'vehicle' | 'nobody';
  text: string;
}

/** MAV_COMP_ID_AUTOPILOT1. */
const AUTOPILOT = 1;

/**
 * @param primary (system id, component id) of the component in control, as the gimbal manager reports it.
 * @param inControl whether this server is in control, as the server reports it.
 */
export function controlHolder(primary: readonly [number, number] | null, inControl: boolean): ControlHolder {
  if (primary === null || (primary[0] === 0 && primary[1] === 0)) return { controller: 'nobody', text: 'not controlled' };
  if (inControl) return { controller: 'server', text: 'controlled by this server' };
  if (primary[1] === AUTOPILOT) return { controller: 'vehicle', text: 'controlled by the vehicle' };
  return { controller: 'other', text: `controlled by system ${primary[0]}, component ${primary[1]}` };
}
