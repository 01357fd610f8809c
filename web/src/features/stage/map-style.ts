/** The map's style, made here: the page's own ground, nothing from elsewhere. No glyphs, no sprites. */

import type { StyleSpecification } from 'maplibre-gl';
import type { Palette } from './map-draw';

export const GROUND = 'ground';

export function mapStyle(palette: Palette): StyleSpecification {
  // At once: a fade would need frames that a slow machine does not draw.
  return {
    version: 8,
    transition: { duration: 0, delay: 0 },
    sources: {},
    layers: [{ id: GROUND, type: 'background', paint: { 'background-color': palette.map } }],
  };
}
