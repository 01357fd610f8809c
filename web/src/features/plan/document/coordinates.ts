/** Coordinates that a person pastes, such as `47.39, 8.54`. Pure functions. */

import type { GeoPosition } from '../../../vehicle/geo';
import { parseTyped } from '../../../vehicle/fields';

const NUMBER = String.raw`[+\-−]?\d+(?:[.,]\d+)?`;
const SEPARATOR = String.raw`(?:\s*[;/]\s*|\s*,\s+|,|\s+)`;
const PAIR = new RegExp(
  String.raw`^\(?\s*(?<south>[NS])?\s*(?<lat>${NUMBER})\s*°?\s*(?<southAfter>[NS])?${SEPARATOR}(?<west>[EW])?\s*(?<lon>${NUMBER})\s*°?\s*(?<westAfter>[EW])?\s*\)?$`,
  'i',
);

export type PastedPosition = { readonly position: GeoPosition } | { readonly problem: string };

/**
 * Latitude and longitude in decimal degrees, north and east positive, or with the letters N, S, E, W.
 * @returns null: the text is no pair of numbers.
 */
export function parseCoordinates(text: string): PastedPosition | null {
  const groups = PAIR.exec(text.trim())?.groups;
  if (groups === undefined) return null;
  const [lat, lon] = [parseTyped(groups['lat'] ?? ''), parseTyped(groups['lon'] ?? '')];
  if (lat === null || lon === null) return null;
  const isSouth = (groups['south'] ?? groups['southAfter'])?.toUpperCase() === 'S';
  const isWest = (groups['west'] ?? groups['westAfter'])?.toUpperCase() === 'W';
  const [lat_deg, lon_deg] = [isSouth ? -lat : lat, isWest ? -lon : lon];
  if (Math.abs(lat_deg) > 90) return { problem: `${lat} is no latitude: it is from −90 to 90°, and comes first. Nothing was added.` };
  if (Math.abs(lon_deg) > 180) return { problem: `${lon} is no longitude: it is from −180 to 180°. Nothing was added.` };
  return { position: { lat_deg, lon_deg } };
}
