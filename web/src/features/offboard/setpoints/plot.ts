/** Plot of target and actual value of one axis over the last minute. Only this module uses uPlot. */

import { inUnit } from '../../../ui/units';
import uPlot from 'uplot';
import 'uplot/dist/uPlot.min.css';
import { WINDOW_S, type Columns } from './traces';

export interface PlotColours {
  actual: string;
  target: string;
  text: string;
  grid: string;
  strokeWidth: number;
}

/** Smallest range of the vertical axis, by unit or quantity (`ui/units.ts`), so that the plot does not magnify noise. */
const MIN_RANGES: Readonly<Record<string, number>> = { length: 1, height: 1, speed: 0.5, climb: 0.5, '°': 4 };

const NOW_TEXT = 'now';

export class AxisPlot {
  private readonly plot: uPlot;

  constructor(
    container: HTMLElement,
    private readonly unit: string,
    colours: PlotColours,
  ) {
    const font = '11px Inter, system-ui, sans-serif';
    const grid = { stroke: colours.grid, width: 1 };
    const minRange = inUnit(unit, MIN_RANGES[unit] ?? 1);
    this.plot = new uPlot(
      {
        width: Math.max(60, container.clientWidth),
        height: Math.max(60, container.clientHeight),
        pxAlign: 1,
        padding: [6, 16, 0, 0],
        legend: { show: false },
        cursor: { show: false },
        scales: {
          x: { time: false, range: () => [-WINDOW_S, 0] },
          y: { range: (_, min, max) => valueRange(min, max, minRange) },
        },
        axes: [
          {
            stroke: colours.text,
            font,
            grid,
            ticks: { show: false },
            size: 20,
            gap: 3,
            splits: () => [-60, -40, -20, 0],
            values: (_, splits) => splits.map((s) => (s === 0 ? NOW_TEXT : `${s} s`.replace('-', '−'))),
          },
          {
            stroke: colours.text,
            font,
            grid,
            ticks: { show: false },
            size: 38,
            gap: 4,
            space: 28,
            values: (_, splits) => splits.map((s) => String(Number(s.toFixed(2))).replace('-', '−')),
          },
        ],
        series: [
          {},
          { stroke: colours.target, width: colours.strokeWidth, points: { show: false }, spanGaps: false },
          { stroke: colours.actual, width: colours.strokeWidth, points: { show: false }, spanGaps: false },
        ],
      },
      [[], [], []],
      container,
    );
  }

  setColumns(columns: Columns): void {
    const [times, ...values] = columns;
    const converted = values.map((column) => column.map((value) => (value === null ? null : inUnit(this.unit, value))));
    this.plot.setData([times, ...converted] as uPlot.AlignedData);
  }

  resize(width: number, height: number): void {
    if (width > 40 && height > 40) this.plot.setSize({ width, height });
  }

  remove(): void {
    this.plot.destroy();
  }
}

function valueRange(min: number | null, max: number | null, minRange: number): [number, number] {
  if (min === null || max === null || !Number.isFinite(min) || !Number.isFinite(max)) return [-minRange / 2, minRange / 2];
  const middle = (min + max) / 2;
  const halfRange = Math.max(minRange / 2, ((max - min) / 2) * 1.12);
  return [middle - halfRange, middle + halfRange];
}
