/** Compares an ended mission with its plan: figures, plots and map. Pure functions. */

import type { components } from '../../../api/schema';
import { deviationTone } from '../../../app/deviation';
import type { LayerLine, LayerContent, Tone } from '../../../app/map-layers.svelte';
import { durationText, fixed, distanceText as knownDistanceText, lengthText as shortLength } from '../../../ui/format';
import { positionAt } from '../../../vehicle/geo';
import type { DryRunResult } from '../dry-run/dry-run.svelte';
import { scaledTrace, type Trace } from '../dry-run/dry-run-trace';

type Schemas = components['schemas'];
export type FlownPath = Readonly<Schemas['FlownMission']>;
type Sample = FlownPath['samples'][number];
type Vector = readonly number[];

/** Movements below this distance [m] are left out of the flown length, as noise of the position estimate. */
const LENGTH_STEP_M = 0.5;
const QUANTILE = 0.95;

/** Labels of `duration_s`, which for an offboard mission excludes take-off and landing. */
const TIME_LABELS = { setpoints: 'Time with setpoints', armed: 'Time armed' } as const;

/** What the planned and the flown values refer to. */
const SOURCE_TEXTS: Readonly<Record<FlownPath['planned_by'], string>> = {
  mission: 'The time covers only the part with setpoints, without take-off and landing, which PX4 flies by itself. The length covers the whole flight.',
  dry_run: 'Planned: the dry run. Both times are from arming to disarming.',
  plan: 'Planned: straight lines between the items, and the estimated time of flight. Flown: from arming to disarming.',
};

/** Distance from the planned path at one time. */
interface PathDistance {
  readonly t_s: number;
  readonly distance_m: number;
}

/** The planned and the flown figures of a mission; null: not known. */
export interface Figures {
  /** Largest distance from the planned path. */
  readonly largestDistance_m: number | null;
  /** 95th percentile of the distances from the planned path. */
  readonly p95Distance_m: number | null;
  readonly rows: readonly FigureRow[];
}

export interface FigureRow {
  readonly name: string;
  readonly planned: string;
  readonly flown: string;
}

export interface FlownPlot {
  readonly trace: Trace;
  /** Time [s] and planned value, one list for each part of the flight with setpoints. */
  readonly plannedParts: readonly (readonly (readonly [number, number])[])[];
}

/** The planned path of the flown steps, and of the steps on the longest path through the branches. */
function plannedLines({ planned_legs, samples }: FlownPath): { place: string; points: readonly Vector[] }[] {
  const flownPlaces = new Set(samples.map(({ place }) => place));
  return planned_legs
    .filter(({ main, place }) => main || flownPlaces.has(place))
    .map(({ place, points }) => ({ place, points: points.map(([, north_m, east_m, down_m]) => [north_m, east_m, down_m]) }));
}

/**
 * Distances from the planned path of the step, for all samples with a planned position. Samples of take-off and landing
 * have no planned position, because PX4 flies both by itself.
 */
export function pathDistances(flownPath: FlownPath): PathDistance[] {
  const lines = plannedLines(flownPath);
  const linesByPlace = new Map<string | null, readonly (readonly Vector[])[]>();
  for (const { place } of flownPath.samples) {
    const stepLines = lines.filter((line) => line.place === place);
    linesByPlace.set(
      place,
      (stepLines.length === 0 ? lines : stepLines).map(({ points }) => points),
    );
  }
  return flownPath.samples.flatMap((sample) => {
    const distance_m = sample.planned_ned_m === null ? Infinity : distanceToLines_m(sample.flown_ned_m, linesByPlace.get(sample.place) ?? []);
    return Number.isFinite(distance_m) ? [{ t_s: sample.t_s, distance_m }] : [];
  });
}

function distanceToLines_m(point: Vector, lines: readonly (readonly Vector[])[]): number {
  let min_m = Infinity;
  for (const points of lines)
    for (let i = 0; i < points.length; i += 1) {
      const end = points[i] ?? point;
      min_m = Math.min(min_m, distanceToSegment_m(point, points[i - 1] ?? end, end));
    }
  return min_m;
}

function distanceToSegment_m(point: Vector, start: Vector, end: Vector): number {
  let [dotProduct, squaredLength] = [0, 0];
  for (let axis = 0; axis < 3; axis += 1) {
    const component = (end[axis] ?? 0) - (start[axis] ?? 0);
    dotProduct += ((point[axis] ?? 0) - (start[axis] ?? 0)) * component;
    squaredLength += component * component;
  }
  const fraction = squaredLength === 0 ? 0 : Math.min(1, Math.max(0, dotProduct / squaredLength));
  return Math.hypot(...[0, 1, 2].map((axis) => (point[axis] ?? 0) - (start[axis] ?? 0) - fraction * ((end[axis] ?? 0) - (start[axis] ?? 0))));
}

/** Length of the flown path. */
export function flownLength_m(samples: readonly Sample[]): number {
  let length_m = 0;
  let previous: Vector | undefined;
  for (const { flown_ned_m: position } of samples) {
    const step_m = previous === undefined ? 0 : Math.hypot(...position.map((value, axis) => value - (previous?.[axis] ?? 0)));
    if (previous !== undefined && step_m < LENGTH_STEP_M) continue;
    length_m += step_m;
    previous = position;
  }
  return length_m;
}

/** The figures of a flight. @param dryRun the dry run that the flight was compared with; null: none. */
export function figures(flownPath: FlownPath, distances: readonly PathDistance[], dryRun: DryRunResult | null): Figures {
  const sorted_m = distances.map(({ distance_m }) => distance_m).sort((a, b) => a - b);
  const lengthText = (value_m: number | null): string => (value_m === null ? 'not known' : knownDistanceText(value_m));
  const dryRunFlight = dryRun?.group == null ? dryRun?.nominal : undefined; // with several vehicles, `nominal` is the flight of the first role
  return {
    largestDistance_m: sorted_m.at(-1) ?? null,
    p95Distance_m: sorted_m[Math.ceil(QUANTILE * sorted_m.length) - 1] ?? null,
    rows: [
      {
        name: TIME_LABELS[flownPath.planned_by === 'mission' ? 'setpoints' : 'armed'],
        planned: durationText(flownPath.planned_duration_s),
        flown: durationText(flownPath.duration_s),
      },
      { name: 'Length', planned: lengthText(flownPath.planned_length_m), flown: lengthText(flownLength_m(flownPath.samples)) },
      {
        name: 'Battery used',
        planned: percentUsed(dryRunFlight?.battery_start_share, dryRunFlight?.battery_end_share),
        flown: percentUsed(flownPath.battery_start_share, flownPath.battery_end_share),
      },
    ],
  };
}

function percentUsed(start: number | null | undefined, end: number | null | undefined): string {
  return start == null || end == null ? 'not known' : `${fixed(100 * (start - end), 0)} %`;
}

/** Text about what the figures refer to. */
export function sourceText({ planned_by }: FlownPath): string {
  return SOURCE_TEXTS[planned_by];
}

/** The largest distance and the 95th percentile as text. */
export function distanceText({ largestDistance_m, p95Distance_m }: Figures, { planned_by }: FlownPath): string {
  if (largestDistance_m === null) {
    const reason = planned_by === 'mission' ? 'the server sent no position setpoints' : 'no planned path is known for this flight';
    return `Distance from the planned path: not known, because ${reason}.`;
  }
  return `Distance from the planned path: at most ${shortLength(largestDistance_m)}; 95 % within ${shortLength(p95Distance_m)}.`;
}

export const FLOWN_QUANTITIES = ['distance', 'altitude'] as const;
export type FlownQuantity = (typeof FLOWN_QUANTITIES)[number];

/** A plot over the time since the start; null: no value is known. */
export function flownPlot(flownPath: FlownPath, distances: readonly PathDistance[], quantity: FlownQuantity): FlownPlot | null {
  const end_s = flownPath.samples.at(-1)?.t_s ?? 0;
  if (quantity === 'distance') {
    const points = distances.map(({ t_s, distance_m }) => [t_s, distance_m] as const);
    return points.length === 0 ? null : { trace: scaledTrace({ unit: 'length', decimals: 1, scaleStep: 1, end_s, points }), plannedParts: [] };
  }
  const start_down_m = flownPath.samples[0]?.flown_ned_m[2];
  if (start_down_m === undefined) return null;
  const up_m = (position: Vector): number => start_down_m - (position[2] ?? 0);
  const points = flownPath.samples.map(({ t_s, flown_ned_m }) => [t_s, up_m(flown_ned_m)] as const);
  const parts: (readonly [number, number])[][] = [[]];
  for (const { t_s, planned_ned_m } of flownPath.samples) {
    if (planned_ned_m === null) parts.push([]);
    else parts.at(-1)?.push([t_s, up_m(planned_ned_m)]);
  }
  const plannedParts = parts.filter((part) => part.length > 1);
  return { trace: scaledTrace({ unit: 'height', decimals: 1, scaleStep: 5, end_s, points, furtherPoints: plannedParts.flat() }), plannedParts };
}

/** The flown path in parts of one colour, by the distance from the planned path. Neighbouring parts share a point. */
export function flownRuns(flownPath: FlownPath): { tone: Tone; points: Vector[] }[] {
  const distances = new Map(pathDistances(flownPath).map(({ t_s, distance_m }) => [t_s, distance_m]));
  const runs: { tone: Tone; points: Vector[] }[] = [];
  for (const { t_s, flown_ned_m } of flownPath.samples) {
    const tone = deviationTone(distances.get(t_s) ?? null);
    const last = runs.at(-1);
    if (last?.tone === tone) last.points.push(flown_ned_m);
    else {
      const previous = last?.points.at(-1);
      runs.push({ tone, points: previous === undefined ? [flown_ned_m] : [previous, flown_ned_m] });
    }
  }
  return runs;
}

/**
 * The planned path (dashed) and the flown path (solid, in colours by its deviation) on the map; null: the origin of the local frame is not known.
 */
export function flownPathLayer(flownPath: FlownPath): LayerContent | null {
  const { origin } = flownPath;
  if (origin === null) return null;
  const positionsOf = (points: readonly Vector[]) => points.map(([north_m = 0, east_m = 0]) => positionAt(origin, { north_m, east_m }));
  const plannedLegs: { place: string; points: Vector[] }[] = [];
  for (const { place, points } of plannedLines(flownPath)) {
    const last = plannedLegs.at(-1);
    const isContinuous = last?.points.at(-1)?.every((value, axis) => Math.abs(value - (points[0]?.[axis] ?? Infinity)) < 0.01) === true;
    if (last !== undefined && isContinuous) last.points.push(...points.slice(1));
    else plannedLegs.push({ place, points: [...points] });
  }
  const lines: LayerLine[] = [
    ...plannedLegs.map(({ points }): LayerLine => ({ positions: positionsOf(points), tone: 'target', style: 'dashed' })),
    ...flownRuns(flownPath).map(({ tone, points }): LayerLine => ({ positions: positionsOf(points), tone, style: 'solid' })),
  ];
  return { lines: lines.filter((line) => line.positions.length > 1), areas: [], points: [] };
}
