/** A quantity of a dry run over time, and its distribution over many flights. Pure functions. */

import { shown } from '../../../ui/format';
import { fromUnit, stepIn } from '../../../ui/units';
import type { DryRunResult } from './dry-run.svelte';

export const QUANTITIES = ['altitude', 'speed', 'tilt', 'battery'] as const;
export type Quantity = (typeof QUANTITIES)[number];

export interface Trace {
  /** A text, or a quantity of `ui/units.ts`; the values are in SI units. */
  readonly unit: string;
  /** Text after the unit. */
  readonly reference: string;
  readonly decimals: number;
  readonly end_s: number;
  /** Time [s] and value. */
  readonly points: readonly (readonly [number, number])[];
  /** Time [s], and the bounds between which the values of 90 % of the flights are. */
  readonly band: readonly (readonly [number, number, number])[];
  /** Time [s] and altitude of the terrain below the vehicle; only in the altitude trace, if the terrain is known. */
  readonly ground: readonly (readonly [number, number])[];
  /** Limits of the vertical scale. */
  readonly top: number;
  readonly bottom: number;
}

const MAX_POINTS = 600;
type Path = NonNullable<DryRunResult['nominal']['path']>;

const DEG_PER_RAD = 180 / Math.PI;
interface QuantitySpec {
  readonly label: string;
  readonly unit: string;
  readonly reference?: string;
  readonly decimals: number;
  readonly scaleStep: number;
  readonly value: (path: Path, i: number) => number | null;
}

export const QUANTITY_SPECS: Readonly<Record<Quantity, QuantitySpec>> = {
  altitude: {
    label: 'Altitude',
    unit: 'height',
    reference: ' above the start',
    decimals: 1,
    scaleStep: 10,
    value: (path, i) => 0 - (path.position_ned_m[i]?.[2] ?? 0),
  },
  speed: { label: 'Speed', unit: 'speed', decimals: 1, scaleStep: 2, value: (path, i) => Math.hypot(...(path.velocity_ned_m_s[i] ?? [])) },
  tilt: { label: 'Tilt', unit: '°', decimals: 0, scaleStep: 10, value: (path, i) => tilt_deg(path.q_ned_frd[i] ?? [1, 0, 0, 0]) },
  battery: {
    label: 'Battery',
    unit: '%',
    decimals: 0,
    scaleStep: 100,
    value: (path, i) => (path.battery_share === null ? null : 100 * (path.battery_share[i] ?? 0)),
  },
};

function tilt_deg([, x, y]: readonly number[]): number {
  return Math.acos(Math.min(1, Math.max(-1, 1 - 2 * ((x ?? 0) ** 2 + (y ?? 0) ** 2)))) * DEG_PER_RAD;
}

/** @returns null: the simulated vehicle did not take off, or the quantity is not known. */
export function traceOf({ nominal, monte_carlo }: DryRunResult, quantity: Quantity): Trace | null {
  const { path } = nominal;
  if (path === null || path.t_s.length === 0) return null;
  const { unit, reference = '', decimals, scaleStep, value } = QUANTITY_SPECS[quantity];
  const stride = Math.max(1, Math.floor(path.t_s.length / MAX_POINTS));
  const indices = path.t_s.flatMap((_, i) => (i % stride === 0 || i === path.t_s.length - 1 ? [i] : []));
  const samples = indices.map((i) => [path.t_s[i] ?? 0, value(path, i)] as const);
  const points = samples.filter((point): point is readonly [number, number] => point[1] !== null);
  if (points.length === 0) return null;
  const corridor = quantity === 'altitude' ? (monte_carlo?.corridor ?? null) : null;
  const band = (corridor?.t_s ?? []).map((t_s, i): [number, number, number] => {
    const up_m = 0 - (corridor?.position_ned_m[i]?.[2] ?? 0);
    return [t_s, up_m + (corridor?.vertical_m.p5[i] ?? 0), up_m + (corridor?.vertical_m.p95[i] ?? 0)];
  });
  const { ground_m } = path;
  const ground = quantity !== 'altitude' || ground_m === null ? [] : indices.map((i): [number, number] => [path.t_s[i] ?? 0, ground_m[i] ?? 0]);
  return scaledTrace({ unit, reference, decimals, scaleStep, end_s: path.t_s.at(-1) ?? 0, points, band, ground });
}

interface UnscaledTrace extends Pick<Trace, 'unit' | 'decimals' | 'end_s' | 'points'> {
  /** The scale ends at multiples of about this value, in the chosen unit. */
  readonly scaleStep: number;
  readonly reference?: string;
  readonly band?: Trace['band'];
  readonly ground?: Trace['ground'];
  /** Other points that the scale must contain. */
  readonly furtherPoints?: Trace['points'];
}

/** A trace whose scale contains zero and all values, except values less than 5 % of `scaleStep` below its lower end. */
export function scaledTrace({ unit, reference = '', decimals, scaleStep, end_s, points, band = [], ground = [], furtherPoints = [] }: UnscaledTrace): Trace {
  const values = [...points, ...ground, ...furtherPoints].map(([, value]) => value).concat(band.flatMap(([, low, high]) => [low, high]));
  const step = fromUnit(unit, stepIn(unit, scaleStep));
  const bottom = Math.min(0, Math.floor(Math.min(...values) / step + 0.05) * step);
  return { unit, reference, decimals, end_s, points, band, ground, top: Math.max(step, Math.ceil(Math.max(...values) / step - 1e-9) * step), bottom };
}

/** A value of a trace with its unit. */
export function quantityText({ unit, reference, decimals }: Pick<Trace, 'unit' | 'reference' | 'decimals'>, value: number): string {
  const { text, unit: name } = shown(unit, value, decimals);
  return `${text} ${name}${reference}`;
}

/** The value at a time, interpolated. */
export function valueAt({ points }: Trace, t_s: number): number {
  const nextIndex = points.findIndex(([t]) => t >= t_s);
  const [next, previous] = [points[nextIndex] ?? points.at(-1), points[Math.max(0, nextIndex - 1)]];
  if (next === undefined || previous === undefined || nextIndex < 0 || next[0] <= previous[0]) return next?.[1] ?? 0;
  return previous[1] + ((t_s - previous[0]) / (next[0] - previous[0])) * (next[1] - previous[1]);
}

export interface PlotPaths {
  readonly line: string;
  /** The band of many flights; empty if there was only one flight. */
  readonly band: string;
  /** The terrain; empty if it is not known. */
  readonly ground: string;
  readonly zero_y: number;
}

/** The trace as SVG paths in a box of this size; y points down. */
export function plotPaths({ points, band, ground, end_s, top, bottom }: Trace, width: number, height: number): PlotPaths {
  const x = (t_s: number): string => ((end_s === 0 ? 0 : t_s / end_s) * width).toFixed(1);
  const y = (value: number): string => (((top - value) / (top - bottom)) * height).toFixed(1);
  const upperPoints = band.map(([t_s, , high]) => `${x(t_s)} ${y(high)}`);
  const lowerPoints = band.map(([t_s, low]) => `${x(t_s)} ${y(low)}`).reverse();
  return {
    line: `M${points.map(([t_s, value]) => `${x(t_s)} ${y(value)}`).join('L')}`,
    band: band.length < 2 ? '' : `M${[...upperPoints, ...lowerPoints].join('L')}Z`,
    ground: ground.length < 2 ? '' : `M0 ${height}L${ground.map(([t_s, up_m]) => `${x(t_s)} ${y(up_m)}`).join('L')}L${width} ${height}Z`,
    zero_y: (top / (top - bottom)) * height,
  };
}

/** The time that a key selects; null for other keys. */
export function timeAfterKey(key: string, hasFineSteps: boolean, t_s: number, end_s: number): number | null {
  const step_s: Readonly<Record<string, number>> = {
    ArrowRight: hasFineSteps ? 0.1 : 1,
    ArrowUp: hasFineSteps ? 0.1 : 1,
    ArrowLeft: hasFineSteps ? -0.1 : -1,
    ArrowDown: hasFineSteps ? -0.1 : -1,
    PageUp: 10,
    PageDown: -10,
    Home: -Infinity,
    End: Infinity,
  };
  const by_s = step_s[key];
  return by_s === undefined ? null : Math.min(end_s, Math.max(0, t_s + by_s));
}
