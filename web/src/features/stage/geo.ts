/** Flat-earth geometry for the page's own small map: metres east and north of a reference. */

export interface Place {
  lat_deg: number;
  lon_deg: number;
}

export interface EastNorth {
  east_m: number;
  north_m: number;
}

const EARTH_RADIUS_M = 6_371_000;
const RAD = Math.PI / 180;

/** Metres from `reference` to `place`; good to 0.1 % within tens of kilometres. */
export function eastNorth(reference: Place, place: Place): EastNorth {
  const longitude = ((((place.lon_deg - reference.lon_deg + 180) % 360) + 360) % 360) - 180;
  return {
    east_m: longitude * RAD * EARTH_RADIUS_M * Math.cos(reference.lat_deg * RAD),
    north_m: (place.lat_deg - reference.lat_deg) * RAD * EARTH_RADIUS_M,
  };
}

export function groundDistance_m(a: Place, b: Place): number {
  const { east_m, north_m } = eastNorth(a, b);
  return Math.hypot(east_m, north_m);
}

export interface MapView {
  centre: EastNorth;
  /** Pixels per metre. */
  scale: number;
  width: number;
  height: number;
}

export interface Pixel {
  x: number;
  y: number;
}

export function toPixel(view: MapView, at: EastNorth): Pixel {
  return {
    x: view.width / 2 + (at.east_m - view.centre.east_m) * view.scale,
    y: view.height / 2 - (at.north_m - view.centre.north_m) * view.scale,
  };
}

export function fromPixel(view: MapView, at: Pixel): EastNorth {
  return {
    east_m: view.centre.east_m + (at.x - view.width / 2) / view.scale,
    north_m: view.centre.north_m - (at.y - view.height / 2) / view.scale,
  };
}

/** A round length [m] whose bar is about `pixels` long: 1, 2 or 5 times a power of ten. */
export function niceLength_m(scale: number, pixels: number): number {
  const raw = pixels / scale;
  const power = 10 ** Math.floor(Math.log10(raw));
  const factor = [5, 2, 1].find((f) => f * power <= raw) ?? 1;
  return factor * power;
}

export const SCALE_MIN = 0.02;
export const SCALE_MAX = 60;

/** The view zoomed by `factor` with the point under `at` kept in place. */
export function zoomAt(view: MapView, at: Pixel, factor: number): MapView {
  const scale = Math.min(SCALE_MAX, Math.max(SCALE_MIN, view.scale * factor));
  const under = fromPixel(view, at);
  return {
    ...view, scale,
    centre: {
      east_m: under.east_m - (at.x - view.width / 2) / scale,
      north_m: under.north_m + (at.y - view.height / 2) / scale,
    },
  };
}
