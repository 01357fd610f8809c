/**
 * Draws layers over the 3D view: paths with their shadows on the ground, areas, solids, points with vertical lines to
 * the ground, and handles to change altitudes. Depends only on a canvas, not on the page.
 */

import type { LayerLine, LayerContent, LayerPoint, LayerPosition } from '../../app/map-layers.svelte';
import type { Pixel } from '../../vehicle/geo';
import { drawIcon, FADED_OPACITY, ICON_HALF_PX, iconName, TONES } from './layer-draw';
import { withHandles } from './layer-gesture';
import type { Palette } from './map-draw';
import { facesOf, type Face } from './scene-solids';
import { NEAR_M, type Clip, type SceneView, type Vector } from './scene-view';

type Ctx = CanvasRenderingContext2D;

/** Maximum number of drawn points; the nearest points are drawn. */
export const MAX_POINTS = 2000;
/** Scale of points in the inset. */
const INSET_SCALE = 0.55;
const HANDLE_RADIUS_PX = 11;

/** The parts of a line in front of the camera, as polylines. */
export function visibleParts(line: readonly Clip[]): Clip[][] {
  const parts: Clip[][] = [];
  let part: Clip[] = [];
  line.forEach((to, i) => {
    const from = line[i - 1];
    if (from !== undefined && from[3] < NEAR_M !== to[3] < NEAR_M) part.push(crossing(from, to));
    if (to[3] >= NEAR_M) part.push(to);
    else if (part.length > 0) {
      parts.push(part);
      part = [];
    }
  });
  return [...parts, part].filter(({ length }) => length > 1);
}

/** The part of an area in front of the camera. */
export function visibleArea(ring: readonly Clip[]): Clip[] {
  return ring.flatMap((to, i) => {
    const from = ring[(i + ring.length - 1) % ring.length] ?? to;
    const crossings = from[3] < NEAR_M !== to[3] < NEAR_M ? [crossing(from, to)] : [];
    return to[3] >= NEAR_M ? [...crossings, to] : crossings;
  });
}

/** The point between `a` and `b` at the distance `NEAR_M` from the camera. */
function crossing(a: Clip, b: Clip): Clip {
  const fraction = (NEAR_M - a[3]) / (b[3] - a[3]);
  const at = (i: 0 | 1 | 2): number => a[i] + fraction * (b[i] - a[i]);
  return [at(0), at(1), at(2), NEAR_M];
}

interface DrawnPoint {
  readonly point: LayerPoint;
  readonly at: Pixel;
  /** Distance from the camera in its viewing direction [m]. */
  readonly depth_m: number;
}

/** The visible points in the order of drawing: midpoints, other points, selected points; each group from far to near. */
export function drawnPoints(view: SceneView, points: readonly LayerPoint[]): DrawnPoint[] {
  const rank = ({ point }: DrawnPoint): number => (point.selected ? 2 : point.mark === 'midpoint' ? 0 : 1);
  return points
    .map((point) => ({ point, clip: view.clipOf(view.enuOf(point)) }))
    .filter(({ clip }) => clip[3] >= NEAR_M)
    .sort((a, b) => a.clip[3] - b.clip[3])
    .slice(0, MAX_POINTS)
    .map(({ point, clip }) => ({ point, at: view.pixelOfClip(clip), depth_m: clip[3] }))
    .sort((a, b) => rank(a) - rank(b) || b.depth_m - a.depth_m);
}

export class ScenePainter {
  private icons = new Map<string, HTMLCanvasElement | null>();

  constructor(
    private readonly ctx: Ctx,
    private readonly palette: Palette,
    private readonly inset: boolean,
  ) {}

  draw(view: SceneView, contents: readonly LayerContent[]): void {
    this.ctx.clearRect(0, 0, view.width, view.height);
    this.ctx.lineCap = this.ctx.lineJoin = 'round';
    const opacity = this.palette.dark ? 0.1 : 0.13;
    for (const { areas } of contents)
      for (const { ring, tone } of areas)
        this.fillArea(view, view.onGround([...ring, ...ring.slice(0, 1)].map((at) => view.enuOf(at))), this.colour(tone), opacity);
    for (const face of facesOf(
      view,
      contents.flatMap(({ solids }) => solids ?? []),
    ))
      this.drawFace(view, face);
    for (const { lines } of contents) for (const line of lines) this.drawShadow(view, line);
    for (const { points } of contents) this.drawGroundLines(view, points);
    for (const { lines } of contents) for (const line of lines) this.drawLine(view, line);
    for (const { points } of contents) {
      for (const { point, at } of drawnPoints(view, points)) this.drawPoint(point, at);
      if (!this.inset) for (const point of withHandles(points)) this.drawHandle(view, point);
    }
  }

  private colour(tone: LayerPoint['tone']): string {
    return this.palette.colour(TONES[tone]);
  }

  /** Begins a path with a line through positions. @returns false: the whole line is behind the camera. */
  private beginLine(view: SceneView, positions: readonly LayerPosition[], onGround = false): boolean {
    this.ctx.beginPath();
    const enu = positions.map((at) => view.enuOf(at));
    return this.addLine(view, onGround ? view.onGround(enu) : enu);
  }

  /** Adds a line to the current path. @returns false: the whole line is behind the camera. */
  private addLine(view: SceneView, line: readonly Vector[]): boolean {
    const parts = visibleParts(line.map((enu) => view.clipOf(enu)));
    for (const part of parts)
      part.forEach((clip, i) => {
        const { x, y } = view.pixelOfClip(clip);
        if (i === 0) this.ctx.moveTo(x, y);
        else this.ctx.lineTo(x, y);
      });
    return parts.length > 0;
  }

  private stroke(colour: string, width: number, opacity = 1, dash: readonly number[] = []): void {
    const { ctx } = this;
    ctx.strokeStyle = colour;
    ctx.lineWidth = width;
    ctx.globalAlpha = opacity;
    ctx.setLineDash([...dash]);
    ctx.stroke();
    ctx.globalAlpha = 1;
    ctx.setLineDash([]);
  }

  private fillArea(view: SceneView, ring: readonly Vector[], colour: string, opacity: number): void {
    const { ctx } = this;
    ctx.beginPath();
    for (const clip of visibleArea(ring.map((enu) => view.clipOf(enu)))) {
      const { x, y } = view.pixelOfClip(clip);
      ctx.lineTo(x, y);
    }
    ctx.fillStyle = colour;
    ctx.globalAlpha = opacity;
    ctx.fill();
    ctx.globalAlpha = 1;
  }

  /** Draws a side or the top of a solid. Hidden sides and edges are drawn weaker. */
  private drawFace(view: SceneView, { ring, edges, tone, facesCamera, shade }: Face): void {
    const colour = this.colour(tone);
    this.fillArea(view, ring, colour, facesCamera ? shade : 0.06);
    this.ctx.beginPath();
    for (const edge of edges) this.addLine(view, edge);
    this.stroke(colour, facesCamera && !this.inset ? 1.6 : 1, facesCamera ? 0.9 : 0.3);
  }

  /** Draws a thin line on the ground below a path, which shows the position of the path from any side. */
  private drawShadow(view: SceneView, { positions }: LayerLine): void {
    if (positions.some((at) => at.alt_amsl_m !== undefined) && this.beginLine(view, positions, true)) this.stroke(this.palette.text2, 1, 0.45);
  }

  private drawLine(view: SceneView, { positions, tone, style, faded }: LayerLine): void {
    const isOnGround = positions.every((at) => at.alt_amsl_m === undefined);
    if (!this.beginLine(view, positions, isOnGround)) return;
    const { palette } = this;
    const width = this.inset ? 1.6 : palette.stroke;
    // A band in the colour of the ground separates the path from the grid and from other lines.
    if (style === 'solid') this.stroke(palette.map, width + 4, 0.75);
    const dash = { solid: [], dotted: [0.1, 6], dashed: [6, 5] }[style];
    this.stroke(this.colour(tone), style === 'dashed' ? 1.6 : width, faded === true ? FADED_OPACITY : 1, dash);
  }

  /** Draws vertical lines from the points to the ground. */
  private drawGroundLines(view: SceneView, points: readonly LayerPoint[]): void {
    const pointsWithAltitude = points.filter((point) => point.alt_amsl_m !== undefined && point.mark !== 'midpoint' && point.mark !== 'home');
    for (const point of pointsWithAltitude.slice(0, MAX_POINTS)) {
      const ground = { lat_deg: point.lat_deg, lon_deg: point.lon_deg };
      const colour = point.selected ? this.palette.accent : this.palette.text2;
      if (this.beginLine(view, [point, ground])) this.stroke(colour, point.selected ? 1.6 : 1, point.selected ? 1 : 0.6);
      const groundPixel = view.pixelOf(ground);
      if (groundPixel === null) continue;
      this.ctx.beginPath();
      this.ctx.arc(groundPixel.x, groundPixel.y, this.inset ? 1.5 : 2.5, 0, 2 * Math.PI);
      this.ctx.fillStyle = colour;
      this.ctx.fill();
    }
  }

  private drawPoint(point: LayerPoint, at: Pixel): void {
    if (this.inset && point.mark === 'midpoint') return;
    const name = iconName(this.inset ? { ...point, text: '' } : point);
    if (!this.icons.has(name)) this.icons.set(name, drawIcon(name, this.palette));
    const icon = this.icons.get(name) ?? null;
    const half_px = ICON_HALF_PX * (this.inset ? INSET_SCALE : 1);
    if (icon !== null) this.ctx.drawImage(icon, at.x - half_px, at.y - half_px, half_px * 2, half_px * 2);
  }

  /** Draws the altitude of a selected point as text, and the handle that changes the altitude. */
  private drawHandle(view: SceneView, point: LayerPoint): void {
    const { ctx, palette } = this;
    const [at, handle] = [view.pixelOf(point), view.handleOf(point)];
    if (at === null) return;
    if (handle !== null) {
      const length_px = Math.hypot(handle.x - at.x, handle.y - at.y);
      const start = { x: at.x + ((handle.x - at.x) / length_px) * 17, y: at.y + ((handle.y - at.y) / length_px) * 17 };
      ctx.beginPath();
      ctx.moveTo(start.x, start.y);
      ctx.lineTo(handle.x, handle.y);
      this.stroke(palette.accent, 2);
      ctx.save();
      ctx.translate(handle.x, handle.y);
      ctx.beginPath();
      ctx.arc(0, 0, HANDLE_RADIUS_PX, 0, 2 * Math.PI);
      ctx.fillStyle = palette.panel;
      ctx.fill();
      this.stroke(palette.accent, 2);
      ctx.rotate(Math.atan2(handle.x - at.x, at.y - handle.y));
      ctx.beginPath();
      ctx.stroke(new Path2D('M0-6v12M-3-3.2L0-6.2 3-3.2M-3 3.2L0 6.2 3 3.2'));
      ctx.restore();
    }
    this.drawTag({ x: at.x + 20, y: at.y }, point.altitudeText ?? '');
  }

  private drawTag(at: Pixel, text: string): void {
    const { ctx, palette } = this;
    ctx.font = '600 12px Inter, system-ui, sans-serif';
    ctx.textAlign = 'left';
    ctx.textBaseline = 'middle';
    const width = ctx.measureText(text).width + 14;
    ctx.beginPath();
    ctx.roundRect(at.x, at.y - 10, width, 20, 6);
    ctx.fillStyle = palette.panel;
    ctx.fill();
    this.stroke(palette.line2, 1);
    ctx.fillStyle = palette.text;
    ctx.fillText(text, at.x + 7, at.y + 0.5);
  }
}
