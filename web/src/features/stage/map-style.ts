/** The map's style, built here without external resources, glyphs or sprites. */

import type { StyleSpecification } from 'maplibre-gl';
import type { Palette } from './map-draw';

export const GROUND = 'ground';

export function mapStyle(palette: Palette): StyleSpecification {
  // Without fading, because a slow computer draws too few frames for it.
  return {
    version: 8,
    transition: { duration: 0, delay: 0 },
    sources: {},
    layers: [{ id: GROUND, type: 'background', paint: { 'background-color': palette.map } }],
  };
}
