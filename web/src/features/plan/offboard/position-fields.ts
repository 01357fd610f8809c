/** The editor's rows of a position: frame, height, coordinates. Pure. */

import type { Field } from './fields';
import type { MissionPosition } from './mission';
import { inFrame, geoPointOf, frameOfPosition, type Frame, type GeoPoint, type PositionFrame } from './positions';

const FRAME_TEXTS: Readonly<Record<PositionFrame, string>> = {
  offset: 'offset from mission start',
  home: 'lat/lon, altitude above home',
  amsl: 'lat/lon, altitude AMSL',
  local: 'offset from local origin',
};
const HEIGHT_LABELS: Readonly<Record<PositionFrame, string>> = {
  offset: 'Altitude above start',
  home: 'Altitude above home',
  amsl: 'Altitude AMSL',
  local: 'Altitude above origin',
};

/**
 * @param put returns the target with the changed position. @param label name of the position. @param key makes the
 * names of its rows unique.
 */
export function positionFields<T>(
  position: MissionPosition,
  frame: Frame,
  put: (target: T, position: MissionPosition) => T,
  label: string,
  key: string,
): Field<T>[] {
  const positionFrame = frameOfPosition(position);
  const geoPoint = geoPointOf(position, frame);
  const height = (): number => {
    if (positionFrame === 'home') return position.alt_home_m ?? 0;
    if (positionFrame === 'amsl') return position.alt_amsl_m ?? 0;
    return -((position.offset_ned_m ?? position.position_ned_m)?.[2] ?? 0) + 0;
  };
  const setHeight = (next: number): MissionPosition => {
    if (positionFrame === 'home') return { ...position, alt_home_m: next };
    if (positionFrame === 'amsl') return { ...position, alt_amsl_m: next };
    return axis(2, -next);
  };
  const axis = (index: number, value: number): MissionPosition => {
    const field = positionFrame === 'offset' ? 'offset_ned_m' : 'position_ned_m';
    return { ...position, [field]: (position[field] ?? [0, 0, 0]).map((one, i) => (i === index ? value : one)) };
  };
  const row = (name: string, text: string, value: number, change: (value: number) => MissionPosition, more: Partial<Field<T>> = {}): Field<T> => ({
    name: `${key}-${name}`,
    label: text,
    of: 'number',
    unit: 'm',
    value,
    set: (target, next) => put(target, change(typeof next === 'number' ? next : 0)),
    ...more,
  });
  const vector = position.offset_ned_m ?? position.position_ned_m;
  const degrees = (limit: number): Partial<Field<T>> => ({ unit: '°', step: 0.00001, decimals: 7, min: -limit, max: limit });
  const where =
    vector != null
      ? [row('north', `${label}: north`, vector[0], (value) => axis(0, value)), row('east', `${label}: east`, vector[1], (value) => axis(1, value))]
      : [
          row('lat', 'Latitude', position.lat_deg ?? 0, (lat_deg) => ({ ...position, lat_deg }), degrees(90)),
          row('lon', 'Longitude', position.lon_deg ?? 0, (lon_deg) => ({ ...position, lon_deg }), degrees(180)),
        ];
  return [
    {
      name: `${key}-way`,
      label: `${label}: given as`,
      of: 'choice',
      value: positionFrame,
      options: (Object.keys(FRAME_TEXTS) as PositionFrame[]).map((value) => ({ value, text: FRAME_TEXTS[value] })),
      set: (target, next) => put(target, inFrame(next as PositionFrame, geoPoint as GeoPoint, frame, position)),
    },
    row('height', HEIGHT_LABELS[positionFrame], height(), setHeight),
    ...where,
  ];
}
