/**
 * What the map shows below everything: the chosen source and the files of the server, and the shades of the ground that the
 * server knows. The page requests them when it first shows the map; the ground later, because the server reads its files first.
 */

import type { Palette } from './map-draw';
import type { components } from '../../api/schema';
import type { LayerSpecification, SourceSpecification } from 'maplibre-gl';
import type { ApiClient } from '../../api/client';

export type Ground = components['schemas']['ElevationFiles'];
const SHADED_KEY = 'gcs-shaded-ground';
const GROUND_ZOOM = { min: 8, max: 14 } as const;

class Maps {
  list = $state.raw<readonly OfflineMap[]>([]);
  /** Files that cannot be shown, each with its reason. */
  unreadableFiles = $state.raw<readonly string[]>([]);
  /** Counts the changes of the list after the first one: the map must then be made again. */
  changes = $state(0);
  /** The elevation files of the server; null: not known yet. */
  ground = $state.raw<Ground | null>(null);
  /** Whether this browser shades the ground. */
  isShaded = $state(storedShading());
  private isRequested = false;

  /** The shades of the ground that the map draws; null: none. */
  get shades(): SourceSpecification | null {
    const url = this.ground?.tiles_url;
    if (!this.isShaded || url == null) return null;
    const zooms = { minzoom: GROUND_ZOOM.min, maxzoom: GROUND_ZOOM.max };
    return { type: 'raster-dem', tiles: [`${location.origin}${url}/{z}/{x}/{y}`], tileSize: 512, encoding: 'terrarium', ...zooms };
  }

  shade(on: boolean): void {
    const before = this.shades;
    this.isShaded = on;
    try {
      localStorage.setItem(SHADED_KEY, String(on));
    } catch {
      // storage is disabled: the choice applies until the page closes
    }
    if (before !== null || this.shades !== null) this.changes += 1;
  }

  async load(api: ApiClient): Promise<void> {
    if (this.isRequested) return;
    this.isRequested = true;
    await this.request(api);
    void this.requestGround(api);
  }

  /** Requests the list again, after a change of the sources or files. */
  async reload(api: ApiClient): Promise<void> {
    await this.request(api);
    this.changes += 1;
    void this.requestGround(api);
  }

  private async requestGround(api: ApiClient): Promise<void> {
    const before = this.ground?.tiles_url ?? null;
    const response = await api.get('/elevation');
    if (!response.ok) return;
    this.ground = response.value;
    if (this.isShaded && before !== response.value.tiles_url) this.changes += 1;
  }

  private async request(api: ApiClient): Promise<void> {
    const response = await api.get('/maps');
    this.isRequested = response.ok;
    if (!response.ok) return;
    this.list = response.value.maps.map((file) => offlineMap(file, location.origin));
    this.unreadableFiles = response.value.unreadable;
  }
}

function storedShading(): boolean {
  try {
    return localStorage.getItem(SHADED_KEY) !== 'false';
  } catch {
    return true; // storage is disabled
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

/** The shades of hills, over the maps and below all else. */
export function shadeLayer(sourceId: string, palette: Palette): LayerSpecification {
  const [shadow, highlight, exaggeration] = palette.dark ? ['#000000', '#9fb4c4', 0.45] : ['#33424d', '#ffffff', 0.35];
  const paint = {
    'hillshade-shadow-color': shadow,
    'hillshade-highlight-color': highlight,
    'hillshade-accent-color': shadow,
    'hillshade-exaggeration': exaggeration,
    'hillshade-illumination-anchor': 'map',
  } as const;
  return { id: sourceId, type: 'hillshade', source: sourceId, paint };
}

/** The attribution that the licences of the maps and elevation files require, without markup. */
export function attributionText(files: readonly { attribution: string | null }[]): string {
  const attributions = files.map((f) =>
    (f.attribution ?? '')
      .replace(/<[^>]*>/g, '')
      .replace(/\s+/g, ' ')
      .trim(),
  );
  return [...new Set(attributions.filter((text) => text !== ''))].join(' · ');
}
