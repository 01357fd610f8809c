/** The map's style, built here without external resources, glyphs or sprites. */

import type { StyleSpecification } from 'maplibre-gl';
import type { Palette } from './map-draw';

export const GROUND = 'ground';

export function mapStyle(palette: Palette): StyleSpecification {
  // No fading: it needs frames that a slow computer does not draw.
  return {
    version: 8,
    transition: { duration: 0, delay: 0 },
    sources: {},
    layers: [{ id: GROUND, type: 'background', paint: { 'background-color': palette.map } }],
  };
}
