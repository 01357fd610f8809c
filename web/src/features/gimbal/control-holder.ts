/** Describes who controls the gimbal. */

export interface ControlHolder {
  who: 'server' | 'other' | 'vehicle' | 'nobody';
  text: string;
}

/** MAV_COMP_ID_AUTOPILOT1. */
const AUTOPILOT = 1;

/**
 * @param primary (system id, component id) in control, as reported by the gimbal manager. @param inControl whether
 * that is this server, as reported by the server.
 */
export function controlHolder(primary: readonly [number, number] | null, inControl: boolean): ControlHolder {
  if (primary === null || (primary[0] === 0 && primary[1] === 0)) return { who: 'nobody', text: 'not controlled' };
  if (inControl) return { who: 'server', text: 'controlled by this server' };
  if (primary[1] === AUTOPILOT) return { who: 'vehicle', text: 'controlled by the vehicle' };
  return { who: 'other', text: `controlled by system ${primary[0]}, component ${primary[1]}` };
}
