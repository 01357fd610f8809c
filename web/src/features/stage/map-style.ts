/** The map's style, made here: background and grid in the page's colours. No glyphs, no sprites, nothing from elsewhere. */

import type { StyleSpecification } from 'maplibre-gl';
import { NO_LINES } from './grid';
import type { Palette } from './map-draw';

export function mapStyle(palette: Palette): StyleSpecification {
  return {
    version: 8,
    sources: { grid: { type: 'geojson', data: NO_LINES, maxzoom: 22, tolerance: 0 } },
    layers: [
      { id: 'background', type: 'background', paint: { 'background-color': palette.map } },
      { id: 'grid-thin', type: 'line', source: 'grid', filter: ['!', ['get', 'major']], paint: { 'line-color': palette.line, 'line-width': 1 } },
      { id: 'grid-strong', type: 'line', source: 'grid', filter: ['get', 'major'], paint: { 'line-color': palette.line2, 'line-width': palette.dark ? 1.2 : 1.6 } },
    ],
  };
}

/** What changes with the theme. */
export function paints(palette: Palette): { layer: string; property: 'background-color' | 'line-color' | 'line-width'; value: string | number }[] {
  return [
    { layer: 'background', property: 'background-color', value: palette.map },
    { layer: 'grid-thin', property: 'line-color', value: palette.line },
    { layer: 'grid-strong', property: 'line-color', value: palette.line2 },
    { layer: 'grid-strong', property: 'line-width', value: palette.dark ? 1.2 : 1.6 },
  ];
}
