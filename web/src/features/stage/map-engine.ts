/**
 * A small interface to MapLibre: camera, gestures and offline tiles. Loaded when the map is first shown; no other
 * module controls MapLibre.
 */

import {
  addProtocol,
  LngLatBounds,
  Map as MapLibre,
  setWorkerCount,
  setWorkerUrl,
  type MapMouseEvent,
  type SourceSpecification,
  type StyleSpecification,
} from 'maplibre-gl';
import workerUrl from 'maplibre-gl/dist/maplibre-gl-worker.mjs?url';
import { Protocol } from 'pmtiles';
import { mercator, type MapView, type Pixel, type GeoPosition } from '../../vehicle/geo';
import idleUrl from './idle-worker.js?url';
import type { LayerContent } from '../../app/map-layers.svelte';
import { LayerPainter } from './layer-draw';
import type { Palette } from './map-draw';
import { shadeLayer, tileLayers, type OfflineMap } from './maps.svelte';

const RAD = Math.PI / 180;
const ZOOM = { min: 7, max: 22 } as const;
/** Margin around fitted positions [px]. */
const FIT_MARGIN_PX = 70;

setWorkerCount(1);
const pmtiles = new Protocol({ metadata: true });
addProtocol('pmtiles', pmtiles.tile);

export interface EngineEvents {
  /** The camera or the tiles changed, and the map was drawn. */
  onDraw: () => void;
  /** A person moved the map. */
  onMove: () => void;
  /** A person clicked or tapped. @param isRight with the right button, or a long press on a touch screen. */
  onClick: (at: Pixel, isRight: boolean) => void;
}

export class MapEngine {
  private readonly map: MapLibre;
  private readonly layers: LayerPainter | null;
  private isStyleLoaded = false;
  private zoomingAboutMiddle = false;

  /**
   * Throws if the browser has no WebGL.
   * @param shades the heights of the ground, whose hills are shaded; null: none.
   * @param editable whether the map draws editable layers, which need MapLibre's worker, as tiles do.
   */
  constructor(
    container: HTMLElement,
    private palette: Palette,
    private readonly offlineMaps: readonly OfflineMap[],
    private readonly shades: SourceSpecification | null,
    readonly editable: boolean,
    events: EngineEvents,
  ) {
    // The worker is loaded from this server: a worker from a blob would need a wider content security policy.
    setWorkerUrl(new URL(offlineMaps.length > 0 || shades !== null || editable ? workerUrl : idleUrl, location.href).href);
    this.map = new MapLibre({
      container,
      style: mapStyle(palette),
      center: [0, 0],
      zoom: ZOOM.min,
      minZoom: ZOOM.min,
      maxZoom: ZOOM.max,
      maxPitch: 0,
      pitchWithRotate: false,
      touchPitch: false,
      keyboard: false,
      doubleClickZoom: false,
      boxZoom: false,
      attributionControl: false,
      renderWorldCopies: true,
      fadeDuration: 0,
      clickTolerance: 5,
      refreshExpiredTiles: false,
      locale: { 'Map.Title': MAP_TITLE },
    });
    this.layers = editable ? new LayerPainter(this.map) : null;
    const canvas = this.map.getCanvas();
    canvas.tabIndex = -1; // the page's own crosshair handles the keyboard
    canvas.setAttribute('aria-hidden', 'true');
    canvas.removeAttribute('role');
    this.map.on('load', () => {
      this.isStyleLoaded = true;
      this.setPalette(this.palette);
    });
    this.map.on('render', events.onDraw);
    for (const eventType of ['dragstart', 'rotatestart', 'zoomstart'] as const) {
      this.map.on(eventType, (event) => {
        if (event.originalEvent !== undefined && (eventType !== 'zoomstart' || !this.zoomingAboutMiddle)) events.onMove();
      });
    }
    for (const type of ['click', 'contextmenu'] as const)
      this.map.on(type, ({ point }: MapMouseEvent) => events.onClick({ x: point.x, y: point.y }, type === 'contextmenu'));
    // eslint-disable-next-line no-console -- a map tile that cannot be read is for developers to see
    this.map.on('error', (event) => console.warn(`map: ${event.error.message}`));
  }

  /** Whether the wheel and a pinch zoom about the middle instead of the pointer: a followed vehicle then stays in the middle. */
  set zoomsAboutMiddle(on: boolean) {
    if (on === this.zoomingAboutMiddle) return;
    this.zoomingAboutMiddle = on;
    const options = on ? ({ around: 'center' } as const) : true;
    for (const handler of [this.map.scrollZoom, this.map.touchZoomRotate]) {
      handler.disable(); // enable() ignores new options while the handler is enabled
      handler.enable(options);
    }
  }

  view(): MapView {
    const { clientWidth: width, clientHeight: height } = this.map.getContainer();
    const { lng, lat } = this.map.unproject([width / 2, height / 2]);
    return { centre: mercator({ lat_deg: lat, lon_deg: lng }), world_px: 512 * 2 ** this.map.getZoom(), up_rad: this.map.getBearing() * RAD, width, height };
  }

  /** Shows a position at an offset from the middle, right and down [px], without animation. */
  jumpTo(at: GeoPosition, offset_px: Pixel, zoom?: number): void {
    const zoomOption = zoom === undefined ? {} : { zoom };
    this.map.jumpTo({
      center: [at.lon_deg, at.lat_deg],
      padding: {
        left: Math.max(0, 2 * offset_px.x),
        right: Math.max(0, -2 * offset_px.x),
        top: Math.max(0, 2 * offset_px.y),
        bottom: Math.max(0, -2 * offset_px.y),
      },
      ...zoomOption,
    });
  }

  /** What the map shows: west, south, east, north [deg]. */
  bounds(): [number, number, number, number] {
    const bounds = this.map.getBounds();
    const lon = (deg: number): number => Math.max(-180, Math.min(180, deg));
    return [lon(bounds.getWest()), bounds.getSouth(), lon(bounds.getEast()), bounds.getNorth()];
  }

  /** The position in the middle of the free area. */
  centre(): GeoPosition {
    const { lat, lng } = this.map.getCenter();
    return { lat_deg: lat, lon_deg: lng };
  }

  get zoom(): number {
    return this.map.getZoom();
  }

  zoomBy(levels: number): void {
    this.map.easeTo({ zoom: this.map.getZoom() + levels, duration: 120 });
  }

  panBy(x: number, y: number): void {
    this.map.panBy([x, y], { duration: 0 });
  }

  northUp(): void {
    this.map.easeTo({ bearing: 0, duration: 120 });
  }

  /** Fits all positions into the free area, with a zoom of at most `max_zoom`. */
  fit(positions: readonly GeoPosition[], max_zoom: number): void {
    const [first] = positions;
    if (first === undefined) return;
    const bounds = new LngLatBounds([first.lon_deg, first.lat_deg], [first.lon_deg, first.lat_deg]);
    for (const position of positions) bounds.extend([position.lon_deg, position.lat_deg]);
    this.map.fitBounds(bounds, { maxZoom: max_zoom, padding: FIT_MARGIN_PX, duration: 0 });
  }

  /** Shows the editable layers; only on an `editable` map. */
  showLayers(contents: readonly LayerContent[]): void {
    this.layers?.show(contents);
  }

  resize(): void {
    this.map.resize();
  }

  setPalette(palette: Palette): void {
    this.palette = palette;
    if (!this.isStyleLoaded) return;
    this.map.setPaintProperty(BACKGROUND_ID, 'background-color', palette.map);
    this.showOfflineMaps();
    this.layers?.restyle(palette);
  }

  remove(): void {
    this.map.remove();
  }

  private showOfflineMaps(): void {
    for (const layer of this.map.getStyle().layers) if (layer.id.startsWith('tiles-')) this.map.removeLayer(layer.id);
    this.offlineMaps.forEach((offlineMap, index) => {
      const name = `tiles-${index}`;
      if (this.map.getSource(name) === undefined) this.map.addSource(name, offlineMap.source);
      for (const layer of tileLayers(offlineMap, name, this.palette)) this.map.addLayer(layer);
    });
    if (this.shades === null) return;
    if (this.map.getSource(SHADES_ID) === undefined) this.map.addSource(SHADES_ID, this.shades);
    this.map.addLayer(shadeLayer(SHADES_ID, this.palette));
  }
}

export const BACKGROUND_ID = 'ground';
/** The canvas's name for screen readers. */
const MAP_TITLE = 'Map';
const SHADES_ID = 'tiles-shades';

export function mapStyle(palette: Palette): StyleSpecification {
  // No transitions: a slow computer draws too few frames for them.
  return {
    version: 8,
    transition: { duration: 0, delay: 0 },
    sources: {},
    layers: [{ id: BACKGROUND_ID, type: 'background', paint: { 'background-color': palette.map } }],
  };
}
