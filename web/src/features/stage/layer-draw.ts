/**
 * Draws editable layers with MapLibre, from one GeoJSON source. The points are icons that this module draws, without
 * glyphs or sprites.
 */

import type { Feature, FeatureCollection, Geometry } from 'geojson';
import type { GeoJSONSource, LayerSpecification, Map as MapLibre } from 'maplibre-gl';
import type { LayerContent, LayerPoint, Tone } from '../../app/map-layers.svelte';
import type { GeoPosition } from '../../vehicle/geo';
import type { Palette } from './map-draw';

const SOURCE_ID = 'edited';
const ID_PREFIX = 'edited-';
/** Image pixels per CSS pixel of an icon. */
const ICON_SCALE = 2;
/** Radius of a point's disc. */
export const POINT_RADIUS_PX: Readonly<Record<LayerPoint['mark'], number>> = { midpoint: 5, corner: 6.5, cross: 9, disc: 13, home: 13, vehicle: 16 };
/** Half the side of an icon [CSS px]. */
export const ICON_HALF_PX = 18;
/** Opacity of what has been flown. */
export const FADED_OPACITY = 0.35;
/** The CSS custom property of each tone. */
export const TONES: Readonly<Record<Tone, string>> = {
  target: '--target',
  caution: '--caution',
  danger: '--danger',
  actual: '--actual',
  text2: '--text-2',
  id2: '--id-2',
  id3: '--id-3',
  id4: '--id-4',
};

type LayerFeature = Feature<Geometry, { kind: string; tone?: Tone; faded?: boolean; icon?: string; sortKey?: number; yaw_deg?: number }>;

const coordinates = (positions: readonly GeoPosition[]): [number, number][] => positions.map((position) => [position.lon_deg, position.lat_deg]);

/** Name of a point's icon; it contains everything that the icon shows. */
export function iconName(point: LayerPoint): string {
  return [ID_PREFIX, point.mark, point.tone, point.selected ? 'on' : point.faded === true ? 'faded' : 'off', point.text].join('|');
}

/** All editable layers as GeoJSON; selected points come last, so that they are drawn on top. */
export function toGeoJson(contents: readonly LayerContent[]): FeatureCollection {
  const features: LayerFeature[] = [];
  for (const { areas, lines, points } of contents) {
    for (const { ring, tone } of areas) {
      const closed = [...coordinates(ring), ...coordinates(ring.slice(0, 1))];
      features.push({ type: 'Feature', properties: { kind: 'area', tone }, geometry: { type: 'Polygon', coordinates: [closed] } });
    }
    for (const { positions, tone, style, faded = false } of lines) {
      features.push({ type: 'Feature', properties: { kind: style, tone, faded }, geometry: { type: 'LineString', coordinates: coordinates(positions) } });
    }
    for (const point of points) {
      const sortKey = point.selected ? 2 : point.mark === 'midpoint' ? 0 : 1;
      const icon = iconName(point);
      const properties = point.mark === 'vehicle' ? { kind: 'vehicle', icon, yaw_deg: point.yaw_deg ?? 0 } : { kind: 'point', icon, sortKey };
      features.push({ type: 'Feature', properties, geometry: { type: 'Point', coordinates: [point.lon_deg, point.lat_deg] } });
    }
  }
  return { type: 'FeatureCollection', features };
}

/** The layers of MapLibre's style that draw the source. */
export function mapLibreLayers(palette: Palette): LayerSpecification[] {
  const colour = ['match', ['get', 'tone'], ...Object.entries(TONES).flatMap(([tone, name]) => [tone, palette.colour(name)]), palette.text2] as never;
  const isKind = (kind: string): never => ['==', ['get', 'kind'], kind] as never;
  const line = (kind: string, paint: object, opacity = 1): LayerSpecification => ({
    id: `${ID_PREFIX}${kind}`,
    type: 'line',
    source: SOURCE_ID,
    // 'solid-band' is a wide transparent line below the features of kind 'solid'.
    filter: isKind(kind.replace('-band', '')),
    layout: { 'line-cap': 'round', 'line-join': 'round' },
    paint: {
      'line-color': colour,
      'line-width': palette.stroke,
      'line-opacity': ['case', ['==', ['get', 'faded'], true], opacity * FADED_OPACITY, opacity],
      ...paint,
    },
  });
  return [
    {
      id: `${ID_PREFIX}area`,
      type: 'fill',
      source: SOURCE_ID,
      filter: isKind('area'),
      paint: { 'fill-color': colour, 'fill-opacity': palette.dark ? 0.08 : 0.1 },
    },
    line('dashed', { 'line-width': 1.6, 'line-dasharray': [4, 3.5] }),
    line('solid-band', { 'line-width': 14 }, 0.13),
    line('dotted', { 'line-width': 2, 'line-dasharray': [0.1, 3] }),
    line('solid', { 'line-width': palette.stroke + 0.4 }),
    {
      id: `${ID_PREFIX}point`,
      type: 'symbol',
      source: SOURCE_ID,
      filter: isKind('point'),
      layout: { 'icon-image': ['get', 'icon'], 'icon-allow-overlap': true, 'icon-ignore-placement': true, 'symbol-sort-key': ['get', 'sortKey'] },
    },
    {
      id: `${ID_PREFIX}vehicle`,
      type: 'symbol',
      source: SOURCE_ID,
      filter: isKind('vehicle'),
      layout: {
        'icon-image': ['get', 'icon'],
        'icon-rotate': ['get', 'yaw_deg'],
        'icon-rotation-alignment': 'map',
        'icon-allow-overlap': true,
        'icon-ignore-placement': true,
      },
    },
  ];
}

/** The icon with this name as an image for MapLibre. */
function imageOf(name: string, palette: Palette): ImageData | null {
  const canvas = drawIcon(name, palette);
  return canvas?.getContext('2d')?.getImageData(0, 0, canvas.width, canvas.height) ?? null;
}

/** Draws the icon with this name. */
export function drawIcon(name: string, palette: Palette): HTMLCanvasElement | null {
  const [, mark, tone, selection, text = ''] = name.split('|');
  const canvas = document.createElement('canvas');
  canvas.width = canvas.height = ICON_HALF_PX * 2 * ICON_SCALE;
  const ctx = canvas.getContext('2d');
  if (ctx === null || mark === undefined || !(tone !== undefined && tone in TONES)) return null;
  const colour = palette.colour(TONES[tone as Tone]);
  const selected = selection === 'on';
  ctx.scale(ICON_SCALE, ICON_SCALE);
  ctx.translate(ICON_HALF_PX, ICON_HALF_PX);
  ctx.lineWidth = palette.stroke;
  ctx.lineCap = 'round';
  if (selection === 'faded') ctx.globalAlpha = FADED_OPACITY + 0.1; // a disc covers less than a line
  const radius = POINT_RADIUS_PX[mark as LayerPoint['mark']];
  if (selected) drawDisc(ctx, radius + 4, null, palette.accent, 2);
  if (mark === 'cross') {
    drawDisc(ctx, radius, palette.panel, colour, 1.6);
    ctx.strokeStyle = colour;
    ctx.stroke(new Path2D('M0-5v10M-5 0h10'));
  } else if (mark === 'vehicle') {
    // A vehicle from above, with a heading arrow. The disc separates it from the lines around it.
    drawDisc(ctx, radius, palette.panel, colour, 1.2);
    ctx.strokeStyle = ctx.fillStyle = colour;
    ctx.stroke(new Path2D('M-6-5L6 7M6-5L-6 7'));
    for (const rotor of ['M-6-5', 'M6-5', 'M-6 7', 'M6 7']) ctx.fill(new Path2D(`${rotor}m-3.5 0a3.5 3.5 0 1 0 7 0a3.5 3.5 0 1 0-7 0`));
    ctx.fill(new Path2D('M-4-9L0-15L4-9Z'));
  } else if (mark === 'home') {
    drawDisc(ctx, radius, palette.panel, colour, palette.stroke);
    ctx.strokeStyle = palette.text;
    ctx.lineWidth = 1.6;
    ctx.stroke(new Path2D('M-5.5 .5l5.5-5.5 5.5 5.5M-3.6 -.5v5.5h7.2v-5.5'));
  } else drawDisc(ctx, radius, selected ? colour : palette.panel, colour, mark === 'midpoint' ? 1.6 : palette.stroke);
  if (text !== '') {
    ctx.font = `700 ${text.length > 2 ? 10 : 12}px Inter, system-ui, sans-serif`;
    ctx.textAlign = 'center';
    ctx.textBaseline = 'middle';
    ctx.fillStyle = selected ? palette.panel : palette.text;
    ctx.fillText(text, 0, 0.5);
  }
  return canvas;
}

function drawDisc(ctx: CanvasRenderingContext2D, radius: number, fill: string | null, stroke: string, width: number): void {
  ctx.beginPath();
  ctx.arc(0, 0, radius, 0, 2 * Math.PI);
  if (fill !== null) {
    ctx.fillStyle = fill;
    ctx.fill();
  }
  ctx.strokeStyle = stroke;
  ctx.lineWidth = width;
  ctx.stroke();
}

/** Paints the layers of one map above its tiles. */
export class LayerPainter {
  private contents: readonly LayerContent[] = [];
  private palette: Palette | null = null;

  constructor(private readonly map: MapLibre) {
    map.setMissingStyleImageResolver((id) => {
      const image = id.startsWith(ID_PREFIX) && this.palette !== null ? imageOf(id, this.palette) : null;
      if (image !== null && !map.hasImage(id)) map.addImage(id, image, { pixelRatio: ICON_SCALE });
    });
  }

  show(contents: readonly LayerContent[]): void {
    this.contents = contents;
    (this.map.getSource(SOURCE_ID) as GeoJSONSource | undefined)?.setData(toGeoJson(contents));
  }

  /** Adds all layers again, after the map's style was loaded or the palette changed. */
  restyle(palette: Palette): void {
    this.palette = palette;
    const { map } = this;
    for (const layer of map.getStyle().layers) if (layer.id.startsWith(ID_PREFIX)) map.removeLayer(layer.id);
    for (const name of map.listImages()) if (name.startsWith(ID_PREFIX)) map.removeImage(name);
    if (map.getSource(SOURCE_ID) === undefined) {
      // MapLibre cuts the data into tiles up to zoom 20; at this and all higher zooms, coordinates have a resolution of a centimetre.
      map.addSource(SOURCE_ID, { type: 'geojson', data: toGeoJson(this.contents), maxzoom: 20, tolerance: 0, buffer: 64 });
    }
    for (const layer of mapLibreLayers(palette)) map.addLayer(layer);
  }
}
