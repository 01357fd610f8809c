/** The flown path of an open flight, for the map and the 3D view. Pure functions. */

import type { LayerContent, LayerLine, LayerPosition } from '../../app/map-layers.svelte';
import { deviationTone } from '../../app/deviation';
import { eastNorth, positionAt, type GeoPosition } from '../../vehicle/geo';
import { indexAfter, valueAt, type FieldSource, type Series } from '../../plots/plot-view.svelte';
import type { FlightRecord } from './log-view.svelte';

/** Fields or expressions of a part: latitude and longitude [°], altitude above sea level [m], heading [°]. */
export type TrackFields = readonly [lat: string, lon: string, alt: string, yaw: string];
export interface TrackPoint {
  readonly t_s: number;
  readonly lat_deg: number;
  readonly lon_deg: number;
  readonly alt_amsl_m: number;
}
export interface Track {
  readonly points: readonly TrackPoint[];
  /** Heading [°], at its own times. */
  readonly yaw: Series | undefined;
}

/** Number of points of a track. */
const POINTS = 1500;

/** The fields of positions of the first part that has them; null: none has. */
export function trackFields(sources: readonly FieldSource[]): TrackFields | null {
  for (const { prefix, topics } of sources) {
    const id = (name: string, field: string): string | undefined =>
      topics.find((topic) => topic.name === name && topic.fields.some((each) => each.name === field))?.id;
    const px4 = id('vehicle_global_position', 'lat');
    if (px4 !== undefined) {
      const q = [0, 1, 2, 3].map((i) => `{${id('vehicle_attitude', 'q[0]') ?? 'vehicle_attitude:0'}/q[${i}]}`).join(', ');
      const yaw = id('vehicle_attitude', 'q[0]') === undefined ? `${px4}/lat` : `yaw(${q})`;
      return [`${prefix}${px4}/lat`, `${prefix}${px4}/lon`, `${prefix}${px4}/alt`, `${prefix}${yaw}`];
    }
    const mavlink = id('GLOBAL_POSITION_INT', 'lat');
    if (mavlink !== undefined) {
      const scaled = (field: string, factor: string): string => `${prefix}{${mavlink}/${field}} * ${factor}`;
      return [scaled('lat', '0.0000001'), scaled('lon', '0.0000001'), scaled('alt', '0.001'), scaled('hdg', '0.01')];
    }
  }
  return null;
}

/** The track of the values of `trackFields`, without a latitude of exactly 0°, which says that there is no position. */
export function trackOf([anyLat, lon, alt, yaw]: readonly (Series | undefined)[]): Track {
  const lat = anyLat === undefined ? undefined : { ...anyLat, values: anyLat.values.map((value) => (value === 0 ? null : value)) };
  const [first_s, last_s] = [lat?.t_s[0], lat?.t_s.at(-1)];
  if (lat === undefined || lon === undefined || alt === undefined || first_s === undefined || last_s === undefined) return { points: [], yaw };
  const points: TrackPoint[] = [];
  for (let i = 0; i < POINTS; i += 1) {
    const t_s = first_s + ((last_s - first_s) * i) / (POINTS - 1);
    const [lat_deg, lon_deg, alt_amsl_m] = [lat, lon, alt].map((series) => between(series, t_s));
    if (lat_deg == null || lon_deg == null || alt_amsl_m == null) continue;
    points.push({ t_s, lat_deg, lon_deg, alt_amsl_m });
  }
  return { points, yaw };
}

/** Where the track is at a time, between its points; null: before its first or after its last one. */
export function positionOn({ points }: Track, t_s: number): TrackPoint | null {
  const next = points.findIndex((point) => point.t_s >= t_s);
  const [a, b] = [points[Math.max(0, next - 1)], points[next]];
  if (a === undefined || b === undefined || (next === 0 && b.t_s > t_s)) return null;
  const part = b.t_s === a.t_s ? 0 : (t_s - a.t_s) / (b.t_s - a.t_s);
  const mix = (from: number, to: number): number => from + (to - from) * part;
  return { t_s, lat_deg: mix(a.lat_deg, b.lat_deg), lon_deg: mix(a.lon_deg, b.lon_deg), alt_amsl_m: mix(a.alt_amsl_m, b.alt_amsl_m) };
}

/** The time at which the track is nearest to a place; null: it is not within this distance. */
export function timeAt({ points }: Track, place: GeoPosition, within_m: number): number | null {
  let [nearest_m, t_s]: [number, number | null] = [within_m, null];
  for (const [i, to] of points.entries()) {
    const from = points[i - 1] ?? to;
    const [leg, way] = [eastNorth(from, to), eastNorth(from, place)];
    const length2 = leg.east_m ** 2 + leg.north_m ** 2;
    const part = length2 === 0 ? 0 : Math.min(1, Math.max(0, (way.east_m * leg.east_m + way.north_m * leg.north_m) / length2));
    const distance_m = Math.hypot(way.east_m - part * leg.east_m, way.north_m - part * leg.north_m);
    if (distance_m < nearest_m) [nearest_m, t_s] = [distance_m, from.t_s + part * (to.t_s - from.t_s)];
  }
  return t_s;
}

/** A path of a rerun, with its times on the main log. */
export interface RerunPath {
  readonly t_s: readonly number[];
  readonly position_ned_m: readonly (readonly number[])[];
  readonly tone: LayerLine['tone'];
  readonly id: string;
}

/**
 * The paths of a rerun on map and in 3D, each with its vehicle at the cursor. They begin where the flown path is then: the log's local
 * origin need not be known. @param logged position at the first time in the local frame of the paths.
 */
export function rerunLayer(
  track: Track | null,
  logged: readonly number[] | undefined,
  paths: readonly RerunPath[],
  cursor_s: number | null,
): LayerContent | null {
  const begin_s = paths[0]?.t_s[0];
  const at = track === null || begin_s === undefined ? null : positionOn(track, begin_s);
  if (at === null || logged === undefined) return null;
  const [north0 = 0, east0 = 0, down0 = 0] = logged;
  const place = ([north_m = 0, east_m = 0, down_m = 0]: readonly number[]): LayerPosition => ({
    ...positionAt(at, { north_m: north_m - north0, east_m: east_m - east0 }),
    alt_amsl_m: at.alt_amsl_m - (down_m - down0),
  });
  const points = paths.flatMap(({ t_s, position_ned_m, tone, id }) => {
    const isInside = cursor_s !== null && cursor_s >= (t_s[0] ?? Infinity) && cursor_s <= (t_s.at(-1) ?? -Infinity);
    const row = isInside ? position_ned_m[Math.max(0, indexAfter(t_s, cursor_s) - 1)] : undefined;
    return row === undefined ? [] : [{ ...place(row), id, mark: 'disc' as const, tone, text: '', selected: false }];
  });
  const lines = paths.map(({ position_ned_m, tone }) => ({ positions: position_ned_m.map(place), tone, style: 'solid' as const }));
  return { points, lines, areas: [], ...groundOf(track) };
}

/** The ground of the 3D view: at the lowest height of the flight. */
function groundOf(track: Track | null): Pick<LayerContent, 'ground'> {
  const [first] = track?.points ?? [];
  if (track === null || first === undefined) return {};
  return { ground: { lat_deg: first.lat_deg, lon_deg: first.lon_deg, alt_amsl_m: Math.min(...track.points.map(({ alt_amsl_m }) => alt_amsl_m)) } };
}

/** The path of a second flight over the open one, with its vehicle. @param at_s the cursor at times of the second flight. @param open the open flight's path. */
export function secondLayer(track: Track | null, at_s: number | null, open: Track | null): LayerContent | null {
  const layer = trackLayer(track, at_s, null);
  if (layer === null) return null;
  const tone = 'id2' as const;
  return {
    ...layer,
    ...groundOf(open),
    points: layer.points.map((point) => ({ ...point, id: 'second', tone })),
    lines: layer.lines.map((line) => ({ ...line, tone })),
  };
}

/** The flown path, the planned one, and the vehicle at the cursor; null: no position is known. */
export function trackLayer(track: Track | null, cursor_s: number | null, record: FlightRecord | null): LayerContent | null {
  if (track === null || track.points.length === 0) return null;
  const at = cursor_s === null ? null : positionOn(track, cursor_s);
  const yaw_deg = cursor_s === null ? null : valueAt(track.yaw, cursor_s);
  const vehicle =
    at === null ? [] : [{ ...at, id: 'cursor', mark: 'vehicle' as const, tone: 'actual' as const, text: '', selected: true, yaw_deg: yaw_deg ?? 0 }];
  return {
    points: vehicle,
    lines: [
      ...plannedLines(record).map((positions) => ({ positions, tone: 'target' as const, style: 'dashed' as const })),
      { positions: track.points, tone: 'actual' as const, style: 'solid' as const },
      ...farLines(record),
    ],
    areas: [],
    ...groundOf(track),
  };
}

/** The planned path of the flown plan or program: one line for each leg. */
function plannedLines(record: FlightRecord | null): LayerPosition[][] {
  const flown = record?.plan?.flown;
  if (flown?.origin == null) return [];
  const { origin } = flown;
  return flown.planned_legs
    .map(({ points }) =>
      points.map(([, north_m = 0, east_m = 0, down_m = 0]) => ({ ...positionAt(origin, { north_m, east_m }), alt_amsl_m: origin.alt_amsl_m - down_m })),
    )
    .filter((positions) => positions.length > 1);
}

/** The parts of the flown path that are far from the planned one, in the colours of Fly. */
function farLines(record: FlightRecord | null): LayerLine[] {
  const flown = record?.plan?.flown;
  if (flown?.origin == null) return [];
  const { origin } = flown;
  const lines: { positions: LayerPosition[]; tone: LayerLine['tone']; style: 'solid' }[] = [];
  let previous: LayerPosition | null = null;
  let tone: LayerLine['tone'] = 'actual';
  for (const {
    flown_ned_m: [north_m = 0, east_m = 0, down_m = 0],
    deviation_m,
  } of flown.samples) {
    const position: LayerPosition = { ...positionAt(origin, { north_m, east_m }), alt_amsl_m: origin.alt_amsl_m - down_m };
    const now = deviationTone(deviation_m);
    if (now !== 'actual' && now !== tone) lines.push({ positions: previous === null ? [] : [previous], tone: now, style: 'solid' });
    if (now !== 'actual') lines.at(-1)?.positions.push(position);
    [previous, tone] = [position, now];
  }
  return lines.filter(({ positions }) => positions.length > 1);
}

/** A value between the samples around a time. */
function between({ t_s: times, values }: Series, t_s: number): number | null {
  const next = indexAfter(times, t_s);
  const [a, b] = [values[next - 1] ?? null, values[next] ?? null];
  const [from_s, to_s] = [times[next - 1], times[next]];
  if (from_s === undefined || to_s === undefined) return a ?? b;
  if (a === null || b === null) return null;
  return a + ((b - a) * (t_s - from_s)) / (to_s - from_s);
}
