/** The map's style, made here: the page's own ground, nothing from elsewhere. No glyphs, no sprites. */

import type { StyleSpecification } from 'maplibre-gl';
import type { Palette } from './map-draw';

export const GROUND = 'ground';

export function mapStyle(palette: Palette): StyleSpecification {
  return { version: 8, sources: {}, layers: [{ id: GROUND, type: 'background', paint: { 'background-color': palette.map } }] };
}
