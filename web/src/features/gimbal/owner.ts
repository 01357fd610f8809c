/** Who steers the gimbal, in words. Station ids follow the MAVLink habit: 255 and near it are ground stations. */

export interface Owner {
  who: 'station' | 'other' | 'vehicle' | 'nobody';
  text: string;
}

/** The MAVLink ids this server sends as, until it has said otherwise. */
export const OWN_SYSTEM_ID = 255;
export const OWN_COMPONENT_ID = 190;

export function owner(primary: readonly [number, number] | null, own: readonly [number, number] = [OWN_SYSTEM_ID, OWN_COMPONENT_ID]): Owner {
  if (primary === null || (primary[0] === 0 && primary[1] === 0)) return { who: 'nobody', text: 'nobody steers' };
  if (primary[0] === own[0] && primary[1] === own[1]) return { who: 'station', text: 'this station' };
  if (primary[1] === 1) return { who: 'vehicle', text: 'the vehicle itself' };
  return { who: 'other', text: `system ${primary[0]}, component ${primary[1]}` };
}
