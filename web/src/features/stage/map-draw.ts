/** Draws the map: grid with its scale, homes, trails, vehicles, targets. Knows a canvas, nothing of the page. */

import type { MapVehicle } from './map-model';
import { fromPixel, niceLength_m, toPixel, type MapView, type Pixel } from './geo';

export interface Palette {
  map: string;
  line: string;
  line2: string;
  text: string;
  text2: string;
  panel: string;
  target: string;
  stroke: number;
  of: (name: string) => string;
}

type Ctx = CanvasRenderingContext2D;

export function drawMap(ctx: Ctx, view: MapView, vehicles: readonly MapVehicle[], palette: Palette, inset: boolean): void {
  ctx.fillStyle = palette.map;
  ctx.fillRect(0, 0, view.width, view.height);
  const cell = niceLength_m(view.scale, inset ? 90 : 150);
  drawGrid(ctx, view, palette, cell);
  for (const v of vehicles) drawTrail(ctx, view, v, palette);
  for (const v of vehicles) if (v.home !== null) drawHome(ctx, toPixel(view, v.home), palette);
  for (const v of vehicles) {
    if (v.look_rad !== null && !v.lost) drawLook(ctx, toPixel(view, v.at), v.look_rad, palette.of(v.colour), inset ? 44 : 90);
    if (v.target !== null) drawTarget(ctx, view, v, v.target, palette, inset);
    drawVehicle(ctx, toPixel(view, v.at), v, palette, inset ? 0.7 : 1);
    if (!inset) drawTag(ctx, toPixel(view, v.at), v.label, palette.of(v.colour), palette);
  }
}

/** The scale bar's length [m] for the page to print beside it. */
export function scaleLength_m(view: MapView): number {
  return niceLength_m(view.scale, 110);
}

function drawGrid(ctx: Ctx, view: MapView, palette: Palette, cell_m: number): void {
  const topLeft = fromPixel(view, { x: 0, y: 0 });
  const bottomRight = fromPixel(view, { x: view.width, y: view.height });
  const lines = (minor_m: number, colour: string): void => {
    ctx.strokeStyle = colour;
    ctx.lineWidth = 1;
    ctx.beginPath();
    for (let e = Math.ceil(topLeft.east_m / minor_m) * minor_m; e <= bottomRight.east_m; e += minor_m) {
      const x = Math.round(toPixel(view, { east_m: e, north_m: 0 }).x) + 0.5;
      ctx.moveTo(x, 0);
      ctx.lineTo(x, view.height);
    }
    for (let n = Math.ceil(bottomRight.north_m / minor_m) * minor_m; n <= topLeft.north_m; n += minor_m) {
      const y = Math.round(toPixel(view, { east_m: 0, north_m: n }).y) + 0.5;
      ctx.moveTo(0, y);
      ctx.lineTo(view.width, y);
    }
    ctx.stroke();
  };
  lines(cell_m / 2, palette.line);
  lines(cell_m * 2, palette.line2);
}

function drawTrail(ctx: Ctx, view: MapView, v: MapVehicle, palette: Palette): void {
  if (v.trail.length === 0) return;
  ctx.strokeStyle = palette.of(v.colour);
  ctx.globalAlpha = v.lost ? 0.4 : 0.85;
  ctx.lineWidth = palette.stroke * (v.selected ? 1.25 : 0.9);
  ctx.lineJoin = ctx.lineCap = 'round';
  ctx.beginPath();
  for (const point of [...v.trail, v.at]) {
    const { x, y } = toPixel(view, point);
    ctx.lineTo(x, y);
  }
  ctx.stroke();
  ctx.globalAlpha = 1;
}

function drawHome(ctx: Ctx, { x, y }: Pixel, palette: Palette): void {
  ctx.save();
  ctx.translate(x, y);
  disc(ctx, 13, palette.panel, palette.text2, 1.5);
  ctx.strokeStyle = palette.text;
  ctx.lineWidth = 1.6;
  ctx.stroke(new Path2D('M-5.5 .5l5.5-5.5 5.5 5.5M-3.6 -.5v5.5h7.2v-5.5'));
  ctx.restore();
}

function drawLook(ctx: Ctx, { x, y }: Pixel, look_rad: number, colour: string, reach: number): void {
  ctx.save();
  ctx.translate(x, y);
  ctx.rotate(look_rad);
  ctx.fillStyle = ctx.strokeStyle = colour;
  ctx.beginPath();
  ctx.moveTo(0, 0);
  ctx.lineTo(-reach * 0.42, -reach);
  ctx.lineTo(reach * 0.42, -reach);
  ctx.closePath();
  ctx.globalAlpha = 0.13;
  ctx.fill();
  ctx.globalAlpha = 0.5;
  ctx.lineWidth = 1;
  ctx.stroke();
  ctx.restore();
}

function drawTarget(ctx: Ctx, view: MapView, v: MapVehicle, target: NonNullable<MapVehicle['target']>, palette: Palette, inset: boolean): void {
  const at = toPixel(view, target.at);
  const from = toPixel(view, v.at);
  ctx.strokeStyle = palette.target;
  ctx.lineWidth = palette.stroke;
  ctx.setLineDash([3, 7]);
  ctx.lineCap = 'round';
  ctx.beginPath();
  ctx.moveTo(from.x, from.y);
  ctx.lineTo(at.x, at.y);
  ctx.stroke();
  ctx.setLineDash([]);
  ctx.save();
  ctx.translate(at.x, at.y);
  disc(ctx, 12, null, palette.target, palette.stroke + 0.4);
  ctx.stroke(new Path2D('M0-6v12M-6 0h12'));
  ctx.restore();
  const apart = Math.hypot(at.x - from.x, at.y - from.y) > 60;
  if (!inset && apart) drawTag(ctx, at, target.label, palette.target, palette);
}

function drawVehicle(ctx: Ctx, { x, y }: Pixel, v: MapVehicle, palette: Palette, size: number): void {
  const colour = palette.of(v.colour);
  ctx.save();
  ctx.translate(x, y);
  ctx.scale(size, size);
  if (v.yaw_rad !== null) ctx.rotate(v.yaw_rad);
  if (!v.lost) {
    ctx.globalAlpha = v.selected ? 0.2 : 0.12;
    disc(ctx, 21, colour, null, 0);
    ctx.globalAlpha = 1;
  }
  ctx.strokeStyle = colour;
  ctx.lineWidth = v.lost ? 1.4 : 2.4;
  if (v.lost) ctx.setLineDash([3, 3]);
  ctx.stroke(new Path2D('M-9-9L9 9M9-9L-9 9'));
  for (const [dx, dy] of [[-9, -9], [9, -9], [-9, 9], [9, 9]] as const) {
    ctx.save();
    ctx.translate(dx, dy);
    disc(ctx, 5.4, palette.map, colour, v.lost ? 1.4 : 2);
    ctx.restore();
  }
  const nose = new Path2D('M0-24l5 8h-10z');
  if (v.yaw_rad !== null && v.lost) ctx.stroke(nose);
  else if (v.yaw_rad !== null) {
    ctx.fillStyle = colour;
    ctx.fill(nose);
  }
  ctx.restore();
}

function drawTag(ctx: Ctx, at: Pixel, text: string, colour: string, palette: Palette): void {
  ctx.font = '600 11.5px Inter, system-ui, sans-serif';
  const width = ctx.measureText(text).width + 16;
  const [x, y] = [at.x + 24, at.y + 10];
  ctx.beginPath();
  ctx.roundRect(x, y, width, 20, 10);
  ctx.fillStyle = palette.panel;
  ctx.fill();
  ctx.strokeStyle = colour;
  ctx.lineWidth = 1;
  ctx.stroke();
  ctx.fillStyle = palette.text;
  ctx.textBaseline = 'middle';
  ctx.fillText(text, x + 8, y + 10.5);
}

function disc(ctx: Ctx, radius: number, fill: string | null, stroke: string | null, width: number): void {
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
