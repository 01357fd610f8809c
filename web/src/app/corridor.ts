/** A corridor around a flown path, as areas for the map. */

import { positionAt, type GeoPosition } from '../vehicle/geo';

/** The corridor is drawn at samples at least `step_m` apart, as areas of `segments_per_area` segments between samples. */
const CORRIDOR = { step_m: 0.5, segments_per_area: 4 } as const;

/**
 * The rings of a corridor that extends to both sides of a path. Several short areas, because a single ring around a path that turns
 * back would cross itself.
 * @param positions_ned_m the path, from `origin`.
 * @param widths_m how far the corridor extends to each side at each position.
 */
export function corridorRings(origin: GeoPosition, positions_ned_m: readonly (readonly number[])[], widths_m: readonly number[]): GeoPosition[][] {
  const samples: { north_m: number; east_m: number; width_m: number }[] = [];
  positions_ned_m.forEach(([north_m = 0, east_m = 0], i) => {
    const last = samples.at(-1);
    if (last === undefined || Math.hypot(north_m - last.north_m, east_m - last.east_m) >= CORRIDOR.step_m)
      samples.push({ north_m, east_m, width_m: widths_m[i] ?? 0 });
  });
  const edgePoints = samples.map((sample, i) => {
    const [previousSample, nextSample] = [samples[Math.max(0, i - 1)] ?? sample, samples[Math.min(samples.length - 1, i + 1)] ?? sample];
    const [north, east] = [nextSample.north_m - previousSample.north_m, nextSample.east_m - previousSample.east_m];
    const length = Math.hypot(north, east) || 1;
    const side = (sign: number): GeoPosition =>
      positionAt(origin, {
        north_m: sample.north_m - (sign * sample.width_m * east) / length,
        east_m: sample.east_m + (sign * sample.width_m * north) / length,
      });
    return { left: side(-1), right: side(1) };
  });
  const rings: GeoPosition[][] = [];
  for (let start = 0; start < edgePoints.length - 1; start += CORRIDOR.segments_per_area) {
    const areaEdgePoints = edgePoints.slice(start, start + CORRIDOR.segments_per_area + 1);
    rings.push([...areaEdgePoints.map(({ left }) => left), ...areaEdgePoints.reverse().map(({ right }) => right)]);
  }
  return rings;
}
