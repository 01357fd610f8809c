/** The server's calls for the sources of map tiles, and for those of the heights of the ground. */

import type { ApiClient, Outcome } from '../../api/client';
import type { components } from '../../api/schema';

export type MapSource = components['schemas']['MapSourceView'];
export type SourceList = components['schemas']['MapSourceList'];
export type RegionSize = components['schemas']['RegionSize'];
export type Operation = components['schemas']['Operation'];
export type MapRegion = components['schemas']['RegionRequest'];
export type GroundRegion = components['schemas']['GroundRegion'];
export type WmtsLayers = components['schemas']['WmtsLayers'];
type NewSource = components['schemas']['NewMapSource'];

export interface SourceCalls<Region> {
  list: () => Promise<Outcome<SourceList>>;
  choose: (source: string | null) => Promise<Outcome<SourceList>>;
  add: (body: NewSource) => Promise<Outcome<MapSource>>;
  remove: (s: string) => Promise<Outcome<unknown>>;
  /** Reads the layers of a WMTS service; absent: such a source cannot be one. */
  layers?: (url: string) => Promise<Outcome<WmtsLayers>>;
  size: (body: Region) => Promise<Outcome<RegionSize>>;
  save: (body: Region) => Promise<Outcome<Operation>>;
}

export const mapCalls = (api: ApiClient): SourceCalls<MapRegion> => ({
  list: () => api.get('/map_sources'),
  choose: (source) => api.put('/map_sources/chosen', { body: { source } }),
  add: (body) => api.post('/map_sources', { body }),
  remove: (s) => api.delete('/map_sources/{s}', { params: { path: { s } } }),
  layers: (url) => api.post('/map_sources/wmts_layers', { body: { url } }),
  size: (body) => api.post('/map_regions/size', { body }),
  save: (body) => api.post('/map_regions', { body }),
});

export const groundCalls = (api: ApiClient): SourceCalls<GroundRegion> => ({
  list: () => api.get('/elevation/sources'),
  choose: (source) => api.put('/elevation/sources/chosen', { body: { source } }),
  add: (body) => api.post('/elevation/sources', { body }),
  remove: (s) => api.delete('/elevation/sources/{s}', { params: { path: { s } } }),
  size: (body) => api.post('/elevation/regions/size', { body }),
  save: (body) => api.post('/elevation/regions', { body }),
});
