/** A plot of several series over time, with one cursor for all plots, and bands for states of the vehicle. */

import uPlot from 'uplot';
import { theme } from '../app/theme.svelte';
import 'uplot/dist/uPlot.min.css';
import type { Series, Window } from './plot-view.svelte';

export interface Colours {
  readonly series: readonly string[];
  readonly text: string;
  readonly grid: string;
  readonly band: string;
  readonly armed: string;
  readonly strokeWidth: number;
}
/** Colours of the theme that is shown. */
export function plotColours(): Colours {
  const css = theme.variables();
  return {
    series: ['--actual', '--target', '--id-2', '--id-3', '--id-4', '--accent', '--ok', '--caution'].map(css),
    text: css('--text-2'),
    grid: css('--line'),
    band: `${css('--danger')}2e`,
    armed: css('--ok'),
    strokeWidth: theme.shown === 'dark' ? 1.4 : 1.8,
  };
}

/** The colours for pairs of series of two flights: the first two are those of the flights on the map. */
export function pairedColours(colours: Colours): Colours {
  const [first = '', next = '', second = '', ...others] = colours.series;
  return { ...colours, series: [first, second, next, ...others] };
}

export interface Bands {
  readonly failsafe: readonly { readonly begin_s: number; readonly end_s: number }[];
  readonly armed: readonly { readonly begin_s: number; readonly end_s: number }[];
  /** Times at which the mode changes. */
  readonly modeChanges_s: readonly number[];
}
export interface Handlers {
  /** A person has chosen a window by dragging, or moved over it by the wheel. */
  readonly zoom: (window: Window) => void;
  readonly cursor: (t_s: number) => void;
}

const WHEEL_FACTOR = 1.25;

/** How a series is drawn. */
export interface Line {
  /** Of a second flight. */
  readonly isDashed: boolean;
  /** Its axis is at the right. */
  readonly isRight: boolean;
}

export class TimePlot {
  private readonly plot: uPlot;
  private bands: Bands = { failsafe: [], armed: [], modeChanges_s: [] };
  private shown: Window = { from_s: 0, to_s: 1 };
  private cursor_s: number | null = null;
  private readonly onWheel: (event: WheelEvent) => void;

  constructor(
    private readonly container: HTMLElement,
    private readonly colours: Colours,
    lines: readonly Line[],
    private readonly handlers: Handlers,
    /** Plots with the same key have one cursor. */
    sync: string,
  ) {
    const font = '11px Inter, system-ui, sans-serif';
    const axis = { stroke: colours.text, font, grid: { stroke: colours.grid, width: 1 }, ticks: { show: false } };
    const yAxis = { ...axis, size: 52, gap: 4, space: 26, values: (_: uPlot, splits: number[]) => splits.map(numberText) };
    const yScale: uPlot.Scale = { range: (_, min, max) => rangeOf(min, max) };
    // An axis without series is not drawn. Lines of the grid are those of the left one, if it is.
    const sides = [false, true].filter((side) => (lines.length === 0 && !side) || lines.some(({ isRight }) => isRight === side));
    const series = lines.map(({ isDashed, isRight }, i) => ({
      scale: isRight ? 'right' : 'y',
      stroke: colours.series[i % colours.series.length] ?? colours.text,
      width: colours.strokeWidth,
      points: { show: false },
      spanGaps: false,
      ...(isDashed ? { dash: [6, 3] } : {}),
    }));
    this.plot = new uPlot(
      {
        width: Math.max(60, container.clientWidth),
        height: Math.max(60, container.clientHeight),
        padding: [6, 8, 0, 0],
        legend: { show: false },
        cursor: { y: false, sync: { key: sync }, drag: { x: true, y: false, setScale: false }, points: { show: false } },
        scales: { x: { time: false, range: () => [this.shown.from_s, this.shown.to_s] }, y: yScale, right: yScale },
        axes: [
          { ...axis, size: 22, gap: 3, values: (_, splits) => splits.map((s) => `${Number(s.toFixed(3))}`.replace('-', '−')) },
          ...sides.map((isRight, i) => ({
            ...yAxis,
            ...(isRight ? { scale: 'right', side: 1 as const } : { scale: 'y' }),
            grid: { ...axis.grid, show: i === 0 },
          })),
        ],
        series: [{}, ...series],
        hooks: {
          draw: [() => this.placeCursor()],
          drawClear: [(plot) => this.drawBands(plot)],
          setSelect: [(plot) => this.onSelect(plot)],
          setCursor: [(plot) => this.onCursor(plot)],
        },
      },
      [[], ...series.map(() => [])] as uPlot.AlignedData,
      container,
    );
    this.onWheel = (event) => this.zoomByWheel(event);
    this.plot.over.addEventListener('wheel', this.onWheel, { passive: false });
    this.plot.over.addEventListener('dblclick', () => this.handlers.zoom({ from_s: -Infinity, to_s: Infinity }));
  }

  show(series: readonly (Series | undefined)[], shown: Window, bands: Bands): void {
    this.shown = shown;
    this.bands = bands;
    this.plot.setData(aligned(series) as uPlot.AlignedData, true);
  }

  setCursor(t_s: number | null): void {
    this.cursor_s = t_s;
    this.placeCursor();
  }

  resize(): void {
    const { clientWidth, clientHeight } = this.container;
    if (clientWidth > 40 && clientHeight > 40) this.plot.setSize({ width: clientWidth, height: clientHeight });
  }

  remove(): void {
    this.plot.destroy();
  }

  /** Draws the cursor at its time, unless the pointer holds it here or the time is not shown. */
  private placeCursor(): void {
    const { cursor_s, shown } = this;
    if (this.isUnderPointer()) return;
    const isShown = cursor_s !== null && cursor_s >= shown.from_s && cursor_s <= shown.to_s;
    const left = isShown ? this.plot.valToPos(cursor_s, 'x') : -10;
    this.plot.setCursor({ left, top: isShown ? this.plot.over.clientHeight / 2 : -10 }, false);
  }

  private isUnderPointer(): boolean {
    return this.plot.over.matches(':hover');
  }

  private onSelect(plot: uPlot): void {
    const { left, width } = plot.select;
    if (width < 4) return;
    const from_s = plot.posToVal(left, 'x');
    const to_s = plot.posToVal(left + width, 'x');
    plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.handlers.zoom({ from_s, to_s });
  }

  private onCursor(plot: uPlot): void {
    const { left } = plot.cursor;
    if (left === undefined || left < 0 || !this.isUnderPointer()) return;
    this.handlers.cursor(plot.posToVal(left, 'x'));
  }

  private zoomByWheel(event: WheelEvent): void {
    if (!event.ctrlKey && !event.shiftKey) return; // the wheel alone scrolls the panes
    event.preventDefault();
    const at_s = this.plot.posToVal(event.offsetX, 'x');
    const factor = event.deltaY > 0 ? WHEEL_FACTOR : 1 / WHEEL_FACTOR;
    this.handlers.zoom({ from_s: at_s - (at_s - this.shown.from_s) * factor, to_s: at_s + (this.shown.to_s - at_s) * factor });
  }

  private drawBands(plot: uPlot): void {
    const { ctx, bbox } = plot;
    const x = (t_s: number): number => Math.min(bbox.left + bbox.width, Math.max(bbox.left, plot.valToPos(t_s, 'x', true)));
    ctx.save();
    ctx.fillStyle = this.colours.band;
    for (const { begin_s, end_s } of this.bands.failsafe) ctx.fillRect(x(begin_s), bbox.top, x(end_s) - x(begin_s), bbox.height);
    ctx.fillStyle = this.colours.armed;
    const line = 3 * devicePixelRatio;
    for (const { begin_s, end_s } of this.bands.armed) ctx.fillRect(x(begin_s), bbox.top + bbox.height - line, x(end_s) - x(begin_s), line);
    ctx.strokeStyle = this.colours.text;
    ctx.globalAlpha = 0.5;
    ctx.setLineDash([3 * devicePixelRatio, 3 * devicePixelRatio]);
    for (const t_s of this.bands.modeChanges_s) {
      if (t_s <= this.shown.from_s || t_s >= this.shown.to_s) continue;
      ctx.beginPath();
      ctx.moveTo(x(t_s), bbox.top);
      ctx.lineTo(x(t_s), bbox.top + bbox.height);
      ctx.stroke();
    }
    ctx.restore();
  }
}

/** The columns of uPlot: all times, and the values of each series at its own times; undefined between them, null where a value is missing. */
export function aligned(series: readonly (Series | undefined)[]): (number | null | undefined)[][] {
  const tables = series.map((each) => [each?.t_s ?? [], each?.values ?? []]);
  if (tables.length === 0) return [[]];
  return uPlot.join(
    tables as uPlot.AlignedData[],
    tables.map(() => [1, 1]),
  ) as (number | null | undefined)[][];
}

function rangeOf(min: number | null, max: number | null): [number, number] {
  if (min === null || max === null || !Number.isFinite(min) || !Number.isFinite(max)) return [-1, 1];
  if (min === max) return [min - (Math.abs(min) || 1), max + (Math.abs(max) || 1)];
  const half = Math.max((max - min) / 2, Math.abs(max) * 1e-6, 1e-9) * 1.08;
  const middle = (min + max) / 2;
  return [middle - half, middle + half];
}

/** A number of an axis in few characters. */
export function numberText(value: number): string {
  const magnitude = Math.abs(value);
  const text = magnitude !== 0 && (magnitude >= 1e6 || magnitude < 1e-3) ? value.toExponential(1) : String(Number(value.toPrecision(6)));
  return text.replace('-', '−');
}
