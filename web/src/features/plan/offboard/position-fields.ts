/** The editor's rows of a position: frame, altitude, coordinates. Pure functions. */

import type { Field } from './fields';
import type { MissionPosition } from './mission';
import { positionInFrame, geoPointOf, positionFrameOf, type MissionFrame, type GeoPoint, type PositionFrame } from './positions';

const FRAME_TEXTS: Readonly<Record<PositionFrame, string>> = {
  offset: 'from mission start',
  home: 'lat/lon, above home',
  amsl: 'lat/lon, AMSL',
  local: 'from local origin',
};
const ALTITUDE_LABELS: Readonly<Record<PositionFrame, string>> = {
  offset: 'altitude above start',
  home: 'altitude above home',
  amsl: 'altitude AMSL',
  local: 'altitude above local origin',
};

/**
 * The rows of a position in any object.
 * @param withPosition returns the target with the changed position.
 * @param label displayed name of the position.
 * @param prefix prefix of the rows' names.
 */
export function positionFields<T>(
  position: MissionPosition,
  frame: MissionFrame,
  withPosition: (target: T, position: MissionPosition) => T,
  label: string,
  prefix: string,
): Field<T>[] {
  const positionFrame = positionFrameOf(position);
  const geoPoint = geoPointOf(position, frame);
  const altitude_m = (): number => {
    if (positionFrame === 'home') return position.alt_home_m ?? 0;
    if (positionFrame === 'amsl') return position.alt_amsl_m ?? 0;
    return -((position.offset_ned_m ?? position.position_ned_m)?.[2] ?? 0) + 0;
  };
  const withAltitude = (next: number): MissionPosition => {
    if (positionFrame === 'home') return { ...position, alt_home_m: next };
    if (positionFrame === 'amsl') return { ...position, alt_amsl_m: next };
    return withAxis(2, -next);
  };
  const withAxis = (index: number, value: number): MissionPosition => {
    const field = positionFrame === 'offset' ? 'offset_ned_m' : 'position_ned_m';
    return { ...position, [field]: (position[field] ?? [0, 0, 0]).map((component, i) => (i === index ? value : component)) };
  };
  const row = (name: string, rowLabel: string, value: number, change: (value: number) => MissionPosition, details: Partial<Field<T>> = {}): Field<T> => ({
    name: `${prefix}-${name}`,
    label: rowLabel,
    type: 'number',
    unit: name === 'height' ? 'height' : 'length',
    value,
    set: (target, next) => withPosition(target, change(typeof next === 'number' ? next : 0)),
    ...details,
  });
  const vector = position.offset_ned_m ?? position.position_ned_m;
  const degreeDetails = (limit: number): Partial<Field<T>> => ({ unit: '°', step: 0.00001, decimals: 7, min: -limit, max: limit });
  const coordinates =
    vector != null
      ? [row('north', `${label}: north`, vector[0], (value) => withAxis(0, value)), row('east', `${label}: east`, vector[1], (value) => withAxis(1, value))]
      : [
          row('lat', 'Latitude', position.lat_deg ?? 0, (lat_deg) => ({ ...position, lat_deg }), degreeDetails(90)),
          row('lon', 'Longitude', position.lon_deg ?? 0, (lon_deg) => ({ ...position, lon_deg }), degreeDetails(180)),
        ];
  return [
    {
      name: `${prefix}-frame`,
      label: `${label}: given as`,
      type: 'choice',
      value: positionFrame,
      options: (Object.keys(FRAME_TEXTS) as PositionFrame[]).map((value) => ({ value, text: FRAME_TEXTS[value] })),
      set: (target, next) => withPosition(target, positionInFrame(next as PositionFrame, geoPoint as GeoPoint, frame, position)),
    },
    row('height', `${label}: ${ALTITUDE_LABELS[positionFrame]}`, altitude_m(), withAltitude),
    ...coordinates,
  ];
}
