/** What the map shows below everything: the chosen source and the files of the server. The page requests them when it first shows the map. */

import type { Palette } from './map-draw';
import type { components } from '../../api/schema';
import type { LayerSpecification, SourceSpecification } from 'maplibre-gl';
import type { ApiClient } from '../../api/client';

class Maps {
  list = $state.raw<readonly OfflineMap[]>([]);
  /** Files that cannot be shown, each with its reason. */
  unreadableFiles = $state.raw<readonly string[]>([]);
  /** Counts the changes of the list after the first one: the map must then be made again. */
  changes = $state(0);
  private isRequested = false;

  async load(api: ApiClient): Promise<void> {
    if (this.isRequested) return;
    this.isRequested = true;
    await this.request(api);
  }

  /** Requests the list again, after a change of the sources or files. */
  async reload(api: ApiClient): Promise<void> {
    await this.request(api);
    this.changes += 1;
  }

  private async request(api: ApiClient): Promise<void> {
    const response = await api.get('/maps');
    this.isRequested = response.ok;
    if (!response.ok) return;
    this.list = response.value.maps.map((file) => offlineMap(file, location.origin));
    this.unreadableFiles = response.value.unreadable;
  }
}

export const maps = new Maps();

export type MapFile = components['schemas']['MapFile'];

export interface OfflineMap {
  file: MapFile;
  source: SourceSpecification;
}

/** A file as a MapLibre source. A PMTiles file contains its own description; tiles of an MBTiles file and of a source are requested one by one. */
export function offlineMap(file: MapFile, origin: string): OfflineMap {
  const url = `${origin}${file.url}`;
  const type = file.tiles === 'vector' ? ('vector' as const) : ('raster' as const);
  const tileSize = type === 'raster' ? { tileSize: 256 } : {};
  if (file.format === 'pmtiles') return { file, source: { type, url: `pmtiles://${url}`, ...tileSize } as SourceSpecification };
  const bounds = file.bounds_deg === null ? {} : { bounds: file.bounds_deg };
  const zoomRange = { minzoom: file.min_zoom, maxzoom: file.max_zoom };
  return { file, source: { type, tiles: [`${url}/{z}/{x}/{y}`], ...zoomRange, ...bounds, ...tileSize } as SourceSpecification };
}

/**
 * The layers of a map: a dimmed raster, so that paths and vehicles are clearly visible, or plain shapes of vector
 * tiles.
 */
export function tileLayers(map: OfflineMap, sourceId: string, palette: Palette): LayerSpecification[] {
  if (map.file.tiles !== 'vector') {
    const rasterPaint = palette.dark ? { 'raster-brightness-max': 0.55, 'raster-saturation': -0.45 } : { 'raster-saturation': -0.25, 'raster-opacity': 0.85 };
    return [{ id: sourceId, type: 'raster', source: sourceId, paint: rasterPaint }];
  }
  return map.file.layers.flatMap((layer, index): LayerSpecification[] => [
    {
      id: `${sourceId}-${index}-area`,
      type: 'fill',
      source: sourceId,
      'source-layer': layer,
      filter: ['==', ['geometry-type'], 'Polygon'],
      paint: { 'fill-color': palette.line, 'fill-opacity': 0.5 },
    },
    {
      id: `${sourceId}-${index}-line`,
      type: 'line',
      source: sourceId,
      'source-layer': layer,
      filter: ['!=', ['geometry-type'], 'Point'],
      paint: { 'line-color': palette.line2, 'line-width': 1.2 },
    },
  ]);
}

/** The attribution that the licences of the maps require, without markup. */
export function attributionText(files: readonly MapFile[]): string {
  const attributions = files.map((f) =>
    (f.attribution ?? '')
      .replace(/<[^>]*>/g, '')
      .replace(/\s+/g, ' ')
      .trim(),
  );
  return [...new Set(attributions.filter((text) => text !== ''))].join(' · ');
}
