/** The map's style, built here without external resources, glyphs or sprites. */

import type { StyleSpecification } from 'maplibre-gl';
import type { Palette } from './map-draw';

export const BACKGROUND_ID = 'ground';

export function mapStyle(palette: Palette): StyleSpecification {
  // No transitions: a slow computer draws too few frames for them.
  return {
    version: 8,
    transition: { duration: 0, delay: 0 },
    sources: {},
    layers: [{ id: BACKGROUND_ID, type: 'background', paint: { 'background-color': palette.map } }],
  };
}
