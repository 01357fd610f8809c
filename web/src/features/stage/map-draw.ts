/** Draws grid, homes, trails, vehicles and targets above the map. Depends only on a canvas, not on the page. */

import type { MapTarget, MapVehicle } from './map-model';
import type { LayerPoint } from '../../app/map-layers.svelte';
import { POINT_RADIUS_PX } from './layer-draw';
import type { EdgeLabel, Grid, GridLine } from './grid';
import { toPixel, type MapView, type Pixel, type GeoPosition } from '../../vehicle/geo';

/** The page's colours for the canvas and the map's style. */
export interface Palette {
  map: string;
  line: string;
  line2: string;
  text: string;
  text2: string;
  text3: string;
  panel: string;
  target: string;
  accent: string;
  dark: boolean;
  stroke: number;
  colour: (name: string) => string;
}

type Ctx = CanvasRenderingContext2D;

/** Width of the gap in the grid lines around a point [px]. */
const POINT_GAP_PX = 2;
const OBSTACLE_RADIUS_PX = 2.5;
/** A trail point is not drawn if its distance from the last drawn point is smaller than this [px]. */
const TRAIL_STEP_PX = 1.5;

/** What the canvas above the map shows. */
export interface MapContent {
  vehicles: readonly MapVehicle[];
  grid: Grid | null;
  /** Whether there are map tiles below the canvas; the grid is then drawn weaker. */
  hasTiles: boolean;
  labels: readonly EdgeLabel[];
  /** Points that MapLibre draws below the canvas; the grid has gaps at these points. */
  editedPoints: readonly LayerPoint[];
  /** The point whose menu is open. */
  mapPoint: GeoPosition | null;
  inset: boolean;
}

export function drawMap(ctx: Ctx, view: MapView, content: MapContent, palette: Palette): void {
  const { vehicles, inset } = content;
  ctx.clearRect(0, 0, view.width, view.height);
  if (content.grid !== null) drawGrid(ctx, view, content.grid, content.hasTiles, palette);
  if (content.grid !== null) clearGridAtPoints(ctx, view, content.editedPoints);
  if (!inset) for (const label of content.labels) drawEdgeLabel(ctx, label, palette);
  for (const v of vehicles) drawTrail(ctx, view, v, palette);
  for (const v of vehicles) drawObstacles(ctx, view, v, palette);
  for (const home of distinctHomes(vehicles)) drawHome(ctx, toPixel(view, home), palette, inset ? 0.75 : 1);
  const tags: TagBox[] = [];
  for (const v of vehicles) {
    const at = toPixel(view, v);
    if (v.camera_yaw_rad !== null && !v.lost && !v.stale)
      drawCameraDirection(ctx, at, v.camera_yaw_rad - view.up_rad, palette.colour(v.colour), inset ? 44 : 90);
    for (const target of v.targets) drawTarget(ctx, view, at, target, palette, inset ? null : tags);
  }
  for (const v of vehicles) drawVehicle(ctx, toPixel(view, v), v, view.up_rad, palette, inset ? 0.7 : v.selected ? 1 : 0.85);
  const selectedFirst = [...vehicles].sort((a, b) => Number(b.selected) - Number(a.selected));
  if (!inset) for (const v of selectedFirst) drawTag(ctx, toPixel(view, v), v.label, colourOf(v, palette), palette, tags);
  if (content.mapPoint !== null) drawMapPoint(ctx, toPixel(view, content.mapPoint), palette);
}

function drawGrid(ctx: Ctx, view: MapView, grid: Grid, hasTiles: boolean, palette: Palette): void {
  const isNorthUp = view.up_rad === 0;
  // In a map with north up, the lines are on the middles of pixels, so that they are sharp.
  const onPixelMiddle = (value: number): number => (isNorthUp ? Math.round(value) + 0.5 : value);
  const lines = (segments: readonly GridLine[], colour: string): void => {
    ctx.strokeStyle = colour;
    ctx.beginPath();
    for (const { from, to } of segments) {
      const [a, b] = [toPixel(view, from), toPixel(view, to)];
      ctx.moveTo(onPixelMiddle(a.x), onPixelMiddle(a.y));
      ctx.lineTo(onPixelMiddle(b.x), onPixelMiddle(b.y));
    }
    ctx.stroke();
  };
  ctx.lineWidth = 1;
  ctx.globalAlpha = hasTiles ? 0.35 : 1;
  lines(grid.thinLines, hasTiles ? palette.text3 : palette.line);
  lines(grid.strongLines, hasTiles ? palette.text3 : palette.line2);
  ctx.globalAlpha = 1;
}

function clearGridAtPoints(ctx: Ctx, view: MapView, points: readonly LayerPoint[]): void {
  ctx.globalCompositeOperation = 'destination-out';
  for (const point of points) {
    const { x, y } = toPixel(view, point);
    ctx.beginPath();
    ctx.arc(x, y, POINT_RADIUS_PX[point.mark] + POINT_GAP_PX, 0, 2 * Math.PI);
    ctx.fill();
  }
  ctx.globalCompositeOperation = 'source-over';
}

/** Draws detected obstacles as small grey dots. */
function drawObstacles(ctx: Ctx, view: MapView, v: MapVehicle, palette: Palette): void {
  if (v.detectedObstacles.length === 0) return;
  ctx.fillStyle = palette.text2;
  for (const position of v.detectedObstacles) {
    const { x, y } = toPixel(view, position);
    ctx.beginPath();
    ctx.arc(x, y, OBSTACLE_RADIUS_PX, 0, 2 * Math.PI);
    ctx.fill();
  }
}

/** The homes of the vehicles; homes at nearly the same position count once. */
function distinctHomes(vehicles: readonly MapVehicle[]): GeoPosition[] {
  const homes = new Map<string, GeoPosition>();
  for (const { home } of vehicles) if (home !== null) homes.set(`${home.lat_deg.toFixed(6)},${home.lon_deg.toFixed(6)}`, home);
  return [...homes.values()];
}

function colourOf(v: MapVehicle, palette: Palette): string {
  return v.stale ? palette.text3 : palette.colour(v.colour);
}

function drawEdgeLabel(ctx: Ctx, label: EdgeLabel, palette: Palette): void {
  ctx.font = '11px Inter, system-ui, sans-serif';
  ctx.fillStyle = palette.text3;
  ctx.textBaseline = label.y === 0 ? 'top' : 'bottom';
  ctx.fillText(label.text, label.x + 5, label.y + (label.y === 0 ? 5 : -3));
}

function drawTrail(ctx: Ctx, view: MapView, v: MapVehicle, palette: Palette): void {
  if (v.trail.length === 0) return;
  ctx.strokeStyle = colourOf(v, palette);
  ctx.globalAlpha = v.lost ? 0.4 : 0.85;
  ctx.lineWidth = palette.stroke * (v.selected ? 1.25 : 0.9);
  ctx.lineJoin = ctx.lineCap = 'round';
  ctx.beginPath();
  let last: Pixel | null = null;
  for (const point of v.trail) {
    const at = toPixel(view, point);
    if (last !== null && Math.abs(at.x - last.x) + Math.abs(at.y - last.y) < TRAIL_STEP_PX) continue;
    ctx.lineTo(at.x, at.y);
    last = at;
  }
  const end = toPixel(view, v);
  ctx.lineTo(end.x, end.y);
  ctx.stroke();
  ctx.globalAlpha = 1;
}

function drawHome(ctx: Ctx, { x, y }: Pixel, palette: Palette, scale: number): void {
  ctx.save();
  ctx.translate(x, y);
  ctx.scale(scale, scale);
  drawDisc(ctx, 13, palette.panel, palette.text2, 1.5);
  ctx.strokeStyle = palette.text;
  ctx.lineWidth = 1.6;
  ctx.stroke(new Path2D('M-5.5 .5l5.5-5.5 5.5 5.5M-3.6 -.5v5.5h7.2v-5.5'));
  ctx.restore();
}

function drawCameraDirection(ctx: Ctx, { x, y }: Pixel, camera_yaw_rad: number, colour: string, length_px: number): void {
  ctx.save();
  ctx.translate(x, y);
  ctx.rotate(camera_yaw_rad);
  ctx.fillStyle = ctx.strokeStyle = colour;
  ctx.beginPath();
  ctx.moveTo(0, 0);
  ctx.lineTo(-length_px * 0.42, -length_px);
  ctx.lineTo(length_px * 0.42, -length_px);
  ctx.closePath();
  ctx.globalAlpha = 0.13;
  ctx.fill();
  ctx.globalAlpha = 0.5;
  ctx.lineWidth = 1;
  ctx.stroke();
  ctx.restore();
}

/** @param tags the tags that are already drawn; null on the small map, which has no tags. */
function drawTarget(ctx: Ctx, view: MapView, from: Pixel, target: MapTarget, palette: Palette, tags: TagBox[] | null): void {
  const at = toPixel(view, target);
  const isCameraTarget = target.kind !== 'go';
  ctx.strokeStyle = palette.target;
  ctx.lineWidth = isCameraTarget ? 1.2 : palette.stroke;
  ctx.setLineDash(isCameraTarget ? [2, 5] : [3, 7]);
  ctx.lineCap = 'round';
  ctx.beginPath();
  ctx.moveTo(from.x, from.y);
  ctx.lineTo(at.x, at.y);
  ctx.stroke();
  ctx.setLineDash([]);
  ctx.save();
  ctx.translate(at.x, at.y);
  if (tags === null) ctx.scale(0.7, 0.7);
  if (target.kind === 'roi') {
    drawDisc(ctx, 3, palette.target, null, 0);
    drawDisc(ctx, 10, null, palette.target, 1.6);
  } else if (target.kind === 'preview') {
    // An unsent setpoint: a dashed ring, and an arrow in the direction of the heading.
    ctx.lineWidth = 1.6;
    ctx.setLineDash([4, 4]);
    ctx.stroke(new Path2D('M12 0A12 12 0 1 1 -12 0A12 12 0 1 1 12 0'));
    ctx.setLineDash([]);
    if (target.yaw_rad != null) {
      ctx.rotate(target.yaw_rad - view.up_rad);
      ctx.stroke(new Path2D('M-5-15l5-8 5 8'));
    }
  } else {
    drawDisc(ctx, 12, null, palette.target, palette.stroke + 0.4);
    ctx.stroke(new Path2D('M0-6v12M-6 0h12'));
  }
  ctx.restore();
  if (tags !== null && Math.hypot(at.x - from.x, at.y - from.y) > 60) drawTag(ctx, at, target.label, palette.target, palette, tags);
}

function drawVehicle(ctx: Ctx, { x, y }: Pixel, v: MapVehicle, up_rad: number, palette: Palette, scale: number): void {
  const colour = colourOf(v, palette);
  ctx.save();
  ctx.translate(x, y);
  ctx.scale(scale, scale);
  if (v.yaw_rad !== null) ctx.rotate(v.yaw_rad - up_rad);
  if (!v.lost) {
    ctx.globalAlpha = v.selected ? 0.2 : 0.12;
    drawDisc(ctx, 21, colour, null, 0);
    ctx.globalAlpha = 1;
  }
  ctx.strokeStyle = colour;
  ctx.lineWidth = v.lost ? 1.4 : 2.4;
  if (v.lost) ctx.setLineDash([3, 3]);
  ctx.stroke(new Path2D('M-9-9L9 9M9-9L-9 9'));
  for (const [dx, dy] of [
    [-9, -9],
    [9, -9],
    [-9, 9],
    [9, 9],
  ] as const) {
    ctx.save();
    ctx.translate(dx, dy);
    drawDisc(ctx, 5.4, palette.map, colour, v.lost ? 1.4 : 2);
    ctx.restore();
  }
  const headingArrow = new Path2D('M0-24l5 8h-10z');
  if (v.yaw_rad !== null && v.lost) ctx.stroke(headingArrow);
  else if (v.yaw_rad !== null) {
    ctx.fillStyle = colour;
    ctx.fill(headingArrow);
  }
  ctx.restore();
}

/** Draws the point whose menu is open: a dot and four short lines around it, in the colour of targets. */
function drawMapPoint(ctx: Ctx, { x, y }: Pixel, palette: Palette): void {
  ctx.save();
  ctx.translate(x, y);
  ctx.strokeStyle = palette.target;
  ctx.lineWidth = palette.stroke;
  ctx.lineCap = 'round';
  ctx.stroke(new Path2D('M0-15v8M0 15v-8M-15 0h8M15 0h-8'));
  drawDisc(ctx, 2, palette.target, null, 0);
  ctx.restore();
}

/** Draws a tag beside a symbol where it covers none of `tags`, and adds it to them. */
function drawTag(ctx: Ctx, at: Pixel, text: string, colour: string, palette: Palette, tags: TagBox[]): void {
  ctx.font = '600 11.5px Inter, system-ui, sans-serif';
  const box = tagBox(at, ctx.measureText(text).width + 16, tags);
  tags.push(box);
  ctx.beginPath();
  ctx.roundRect(box.x, box.y, box.width, TAG_HEIGHT_PX, TAG_HEIGHT_PX / 2);
  ctx.fillStyle = palette.panel;
  ctx.fill();
  ctx.strokeStyle = colour;
  ctx.lineWidth = 1;
  ctx.stroke();
  ctx.fillStyle = palette.text;
  ctx.textBaseline = 'middle';
  ctx.fillText(text, box.x + 8, box.y + TAG_HEIGHT_PX / 2 + 0.5);
}

function drawDisc(ctx: Ctx, radius: number, fill: string | null, stroke: string | null, width: number): void {
  ctx.beginPath();
  ctx.arc(0, 0, radius, 0, 2 * Math.PI);
  if (fill !== null) {
    ctx.fillStyle = fill;
    ctx.fill();
  }
  if (stroke !== null) {
    ctx.strokeStyle = stroke;
    ctx.lineWidth = width;
    ctx.stroke();
  }
}

/** The rectangle of a tag [px]; `x` and `y` are its upper left corner. */
export interface TagBox extends Pixel {
  width: number;
}

export const TAG_HEIGHT_PX = 20;
/** Distance of a tag from the middle of its symbol: beside it, and below or above it [px]. */
const BESIDE_PX = 24;
const BELOW_PX = 10;
/** Distance from a tag to the next tag below it [px]. */
const ROW_PX = TAG_HEIGHT_PX + 3;
const MAX_ROWS = 4;

function overlap(a: TagBox, b: TagBox): boolean {
  return a.x < b.x + b.width && b.x < a.x + a.width && Math.abs(a.y - b.y) < TAG_HEIGHT_PX;
}

/** The first place for a tag where it covers none of the `placed` tags; if there is none, the usual place. */
export function tagBox(at: Pixel, width: number, placed: readonly TagBox[]): TagBox {
  const [right, left] = [at.x + BESIDE_PX, at.x - BESIDE_PX - width];
  const [below, above] = [at.y + BELOW_PX, at.y - BELOW_PX - TAG_HEIGHT_PX];
  const usual = { x: right, y: below, width };
  const others = [
    { x: right, y: above, width },
    { x: left, y: below, width },
    { x: left, y: above, width },
    ...Array.from({ length: MAX_ROWS }, (_, row) => ({ x: right, y: below + (row + 1) * ROW_PX, width })),
  ];
  return [usual, ...others].find((box) => !placed.some((other) => overlap(box, other))) ?? usual;
}
