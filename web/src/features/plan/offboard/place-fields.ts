/** The editor's rows of a position: frame, height, coordinates. Pure. */

import type { Field } from './fields';
import type { MissionPosition } from './mission';
import { inFrame, geoPointOf, frameOfPosition, type Frame, type GeoPoint, type PositionFrame } from './places';

const WAYS: Readonly<Record<PositionFrame, string>> = {
  offset: 'from the start',
  home: 'lat/lon, above home',
  amsl: 'lat/lon, AMSL',
  local: 'from local origin',
};
const HEIGHTS: Readonly<Record<PositionFrame, string>> = {
  offset: 'Height above start',
  home: 'Height above home',
  amsl: 'Altitude AMSL',
  local: 'Height above origin',
};

/**
 * @param put returns the target with the changed position. @param label name of the position. @param key makes the
 * names of its rows unique.
 */
export function positionFields<T>(place: MissionPosition, frame: Frame, put: (target: T, place: MissionPosition) => T, label: string, key: string): Field<T>[] {
  const positionFrame = frameOfPosition(place);
  const geoPoint = geoPointOf(place, frame);
  const height = (): number => {
    if (positionFrame === 'home') return place.alt_home_m ?? 0;
    if (positionFrame === 'amsl') return place.alt_amsl_m ?? 0;
    return -((place.offset_ned_m ?? place.position_ned_m)?.[2] ?? 0) + 0;
  };
  const setHeight = (next: number): MissionPosition => {
    if (positionFrame === 'home') return { ...place, alt_home_m: next };
    if (positionFrame === 'amsl') return { ...place, alt_amsl_m: next };
    return axis(2, -next);
  };
  const axis = (index: number, value: number): MissionPosition => {
    const field = positionFrame === 'offset' ? 'offset_ned_m' : 'position_ned_m';
    return { ...place, [field]: (place[field] ?? [0, 0, 0]).map((one, i) => (i === index ? value : one)) };
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
  const vector = place.offset_ned_m ?? place.position_ned_m;
  const degrees = (limit: number): Partial<Field<T>> => ({ unit: '°', step: 0.00001, decimals: 7, min: -limit, max: limit });
  const where =
    vector != null
      ? [row('north', `${label}: north`, vector[0], (value) => axis(0, value)), row('east', `${label}: east`, vector[1], (value) => axis(1, value))]
      : [
          row('lat', 'Latitude', place.lat_deg ?? 0, (lat_deg) => ({ ...place, lat_deg }), degrees(90)),
          row('lon', 'Longitude', place.lon_deg ?? 0, (lon_deg) => ({ ...place, lon_deg }), degrees(180)),
        ];
  return [
    {
      name: `${key}-way`,
      label,
      of: 'choice',
      value: positionFrame,
      options: (Object.keys(WAYS) as PositionFrame[]).map((value) => ({ value, text: WAYS[value] })),
      set: (target, next) => put(target, inFrame(next as PositionFrame, geoPoint as GeoPoint, frame, place)),
    },
    row('height', HEIGHTS[positionFrame], height(), setHeight),
    ...where,
  ];
}
