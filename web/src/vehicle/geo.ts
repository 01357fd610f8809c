/** Geometry of the map: geographic positions, offsets in metres, and pixels of a Web Mercator map. */

export interface GeoPosition {
  lat_deg: number;
  lon_deg: number;
}

export interface EastNorth {
  east_m: number;
  north_m: number;
}

export interface Pixel {
  x: number;
  y: number;
}

/** Earth radius of PX4's local frame projection, so that distances agree with PX4 [m]. */
const EARTH_RADIUS_M = 6_371_000;
const RAD = Math.PI / 180;

/** Wraps a longitude, or a difference of two longitudes, to −180…180 [deg]. */
function wrapLongitude(lon_deg: number): number {
  return ((((lon_deg + 180) % 360) + 360) % 360) - 180;
}

/** Offset from `reference` to `position`; accurate to 0.1 % within tens of kilometres. */
export function eastNorth(reference: GeoPosition, position: GeoPosition): EastNorth {
  return {
    east_m: wrapLongitude(position.lon_deg - reference.lon_deg) * RAD * EARTH_RADIUS_M * Math.cos(reference.lat_deg * RAD),
    north_m: (position.lat_deg - reference.lat_deg) * RAD * EARTH_RADIUS_M,
  };
}

/** The position at an offset from `reference`. */
export function positionAt(reference: GeoPosition, offset: EastNorth): GeoPosition {
  return {
    lat_deg: reference.lat_deg + offset.north_m / EARTH_RADIUS_M / RAD,
    lon_deg: wrapLongitude(reference.lon_deg + offset.east_m / (EARTH_RADIUS_M * Math.cos(reference.lat_deg * RAD)) / RAD),
  };
}

export function groundDistance_m(a: GeoPosition, b: GeoPosition): number {
  const { east_m, north_m } = eastNorth(a, b);
  return Math.hypot(east_m, north_m);
}

/** Bearing from `a` to `b`, clockwise from north [rad]. */
export function bearing_rad(a: GeoPosition, b: GeoPosition): number {
  const { east_m, north_m } = eastNorth(a, b);
  return Math.atan2(east_m, north_m);
}

/** Web Mercator: the world from 0 to 1, y southwards. */
export interface Mercator {
  x: number;
  y: number;
}

export function mercator(position: GeoPosition): Mercator {
  return {
    x: (180 + position.lon_deg) / 360,
    y: (180 - Math.log(Math.tan(Math.PI / 4 + (position.lat_deg * RAD) / 2)) / RAD) / 360,
  };
}

function fromMercator(point: Mercator): GeoPosition {
  return { lon_deg: wrapLongitude(point.x * 360 - 180), lat_deg: Math.atan(Math.sinh((180 - point.y * 360) * RAD)) / RAD };
}

/** The part of the map that is visible now. */
export interface MapView {
  centre: Mercator;
  /** Width of the whole world [px]. */
  world_px: number;
  /** Direction of the screen's upper edge, clockwise from north [rad]. */
  up_rad: number;
  width: number;
  height: number;
}

export function toPixel(view: MapView, position: GeoPosition): Pixel {
  const point = mercator(position);
  const offsetX = point.x - view.centre.x;
  const dx = (offsetX - Math.round(offsetX)) * view.world_px;
  const dy = (point.y - view.centre.y) * view.world_px;
  const [cos, sin] = [Math.cos(view.up_rad), Math.sin(view.up_rad)];
  return { x: view.width / 2 + dx * cos + dy * sin, y: view.height / 2 - dx * sin + dy * cos };
}

export function fromPixel(view: MapView, pixel: Pixel): GeoPosition {
  const [px, py] = [pixel.x - view.width / 2, pixel.y - view.height / 2];
  const [cos, sin] = [Math.cos(view.up_rad), Math.sin(view.up_rad)];
  return fromMercator({
    x: view.centre.x + (px * cos - py * sin) / view.world_px,
    y: view.centre.y + (px * sin + py * cos) / view.world_px,
  });
}

/** Pixels per metre in the middle of the view. */
export function pixelsPerMetre(view: MapView): number {
  const lat_rad = fromMercator(view.centre).lat_deg * RAD;
  return view.world_px / (2 * Math.PI * EARTH_RADIUS_M * Math.cos(lat_rad));
}

/**
 * The point that is nearest to the pixel `at`, within `maxDistance_px`; null if there is none.
 * @param pixelOf a point's pixel; null: it is not visible.
 */
export function nearestWithin<T>(pixelOf: (point: T) => Pixel | null, at: Pixel, points: readonly T[], maxDistance_px: number): T | null {
  let best: T | null = null;
  let bestDistance = maxDistance_px;
  for (const point of points) {
    const pixel = pixelOf(point);
    const distance = pixel === null ? Infinity : Math.hypot(pixel.x - at.x, pixel.y - at.y);
    if (distance <= bestDistance) [best, bestDistance] = [point, distance];
  }
  return best;
}

/** The server compares a flight with a dry run only if their starts are closer than this [m]. */
const SAME_START_M = 5;

/** Whether a vehicle is at the start of its dry run. */
export function isSameStart(position: GeoPosition, start: GeoPosition): boolean {
  return groundDistance_m(position, start) < SAME_START_M;
}

/** The position at an offset from the map's middle, and the distance from this position to the nearest edge of the map. */
export function positionAtOffset(view: MapView, { x, y }: Pixel): { at: GeoPosition; edgeDistance_m: number } {
  const edgeDistance_px = Math.min(view.width / 2 - Math.abs(x), view.height / 2 - Math.abs(y));
  return { at: fromPixel(view, { x: view.width / 2 + x, y: view.height / 2 + y }), edgeDistance_m: edgeDistance_px / pixelsPerMetre(view) };
}
