/** What if: a part of the open log is flown again in simulation, unchanged and with a change, and shown beside the log. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import type { LayerContent } from '../../app/map-layers.svelte';
import type { Series } from '../../plots/plot-view.svelte';
import { RERUN } from '../../plots/sets';
import type { LogPart, LogView } from './log-view.svelte';
import { rerunLayer, type RerunPath } from './track';

type Schemas = components['schemas'];
export type Rerun = Schemas['RerunResult'];
type Track = Schemas['RerunTrack'];
export type RerunBody = Schemas['RerunRequest'];
type Lost = NonNullable<RerunBody['lost']>[number];
type Then = NonNullable<Schemas['ChangedItem']['then']>;

type PlanVersion = Schemas['PlanVersion'];
type Said = Pick<Problem, 'title' | 'detail'>;

/** What is changed: how logged setpoints are followed; or, with the simulated PX4 that makes them, a failsafe, or an item of its plan or a step of its mission. */
export type ChangeKind = 'control' | 'failsafe' | 'item';
const USUAL_S: Readonly<Record<ChangeKind, string>> = { control: '20', failsafe: '60', item: '60' };
const MAX_S: Readonly<Record<ChangeKind, number>> = { control: 120, failsafe: 600, item: 600 };

export interface ChangedParameter {
  readonly name: string;
  readonly value: number;
}

const STEP = /^[1-9].{0,190}$/;
/** The step as the server names it; not a text, which would be translated. */
const placeOf = (step: string): string => ['step', step.trim()].join(' ');
const numberOf = (text: string): number | null => (text.trim() === '' || !Number.isFinite(Number(text)) ? null : Number(text));
const isBetween = (text: string, low: number, high: number): boolean => {
  const value = numberOf(text);
  return text.trim() === '' || (value !== null && value >= low && value <= high);
};

export class WhatIf {
  kind = $state<ChangeKind>('control');
  parameters = $state.raw<readonly ChangedParameter[]>([]);
  /** Motor that stops, 1 to 4; 0: none. */
  stoppedMotor = $state(0);
  /** Wind instead of the one in the log, the direction it blows to [m/s]; empty: as in the log. */
  windNorth = $state('');
  windEast = $state('');
  duration = $state('20');
  /** What is added to the position setpoints [m]; empty: they are as logged. */
  movedNorth = $state('');
  movedEast = $state('');
  movedUp = $state('');
  /** Id of the plan that was flown; empty: the one that was noted with the flight. */
  plan = $state('');
  plans = $state.raw<readonly PlanVersion[] | null>(null);
  plansProblem = $state.raw<Said | null>(null);
  /** What is lost at the moment; empty: nothing. */
  lost = $state<Lost | ''>('');
  /** Charge at the moment [%]; empty: as logged. */
  battery = $state('');
  /** Number of the changed item, from 1. */
  item = $state('');
  /** The changed step of an offboard mission, as the mission names it without "step": 3, 4.2. */
  step = $state('');
  /** Its point, from 1; empty: all. */
  point = $state('');
  /** How long it holds or waits [s]; empty: as planned. */
  stepDuration = $state('');
  /** Speed from the item on, or of the step [m/s]; empty: as planned. */
  speed = $state('');
  /** What follows the item; empty: the next one. */
  then = $state<Then | ''>('');
  isBusy = $state(false);
  result = $state.raw<Rerun | null>(null);
  problem = $state.raw<Said | null>(null);
  /** The unchanged and the changed path of the result, for map and 3D. */
  paths = $state.raw<readonly RerunPath[]>([]);
  /** Of the result's times to those of the plots [s]. */
  offset_s = 0;
  private request = 0;

  constructor(
    private readonly api: ApiClient,
    private readonly view: LogView,
  ) {}

  /** The vehicle's own log of the open flight; a recording of telemetry has no setpoints. */
  get log(): LogPart | undefined {
    return this.view.parts.find(({ overview }) => overview.kind === 'ulog');
  }

  /** Forgets the change and its result, as it is of another log. */
  reset(): void {
    this.request += 1;
    this.parameters = [];
    this.kind = 'control';
    this.duration = USUAL_S.control;
    this.plan = this.lost = this.battery = this.item = this.step = this.point = this.stepDuration = this.speed = this.then = '';
    this.stoppedMotor = 0;
    this.windNorth = this.windEast = this.movedNorth = this.movedEast = this.movedUp = '';
    this.isBusy = false;
    this.result = this.problem = null;
    this.paths = [];
  }

  /** The paths of the result beside the flown one, at the cursor of the plots. */
  layer(): LayerContent | null {
    return rerunLayer(this.view.track, this.result?.logged.position_ned_m[0], this.paths, this.view.cursor_s);
  }

  readonly isBatteryValid = $derived(isBetween(this.battery, 0, 100));
  readonly isSpeedValid = $derived(isBetween(this.speed, 0.1, 30));
  readonly isItemValid = $derived(isBetween(this.item, 1, 10_000) && Number.isInteger(Number(this.item)));
  readonly isStepValid = $derived(this.step.trim() === '' || STEP.test(this.step.trim()));
  readonly isPointValid = $derived(isBetween(this.point, 1, 5000) && Number.isInteger(Number(this.point)));
  readonly isStepDurationValid = $derived(isBetween(this.stepDuration, 0, 3600));
  /** Whether an item is a step: the chosen plan, or the one that was noted with the flight, is an offboard mission. */
  readonly isOfMission = $derived.by(() => {
    const chosen = this.plan === '' ? this.view.record?.plan : this.plans?.find(({ id }) => id === this.plan);
    return this.kind === 'item' && chosen?.kind === 'offboard_mission';
  });
  readonly maxDuration_s = $derived(MAX_S[this.kind]);
  /** Whether the fields of this kind of change can be flown. */
  readonly isValid = $derived.by(() => {
    const duration_s = numberOf(this.duration);
    const isItemValid = this.isOfMission
      ? this.isStepValid && this.isPointValid && this.isStepDurationValid && this.step.trim() !== ''
      : this.isItemValid && this.item.trim() !== '';
    const isOwnValid = { control: true, failsafe: this.isBatteryValid, item: isItemValid && this.isSpeedValid }[this.kind];
    return isOwnValid && duration_s !== null && duration_s >= 1 && duration_s <= this.maxDuration_s;
  });

  /** Chooses what is changed; a duration that nobody has changed is the usual one of it. */
  choose(kind: ChangeKind): void {
    if (this.duration === USUAL_S[this.kind]) this.duration = USUAL_S[kind];
    this.kind = kind;
  }

  /** Loads the plans of this server, one of which may have been flown. */
  async loadPlans(): Promise<void> {
    const response = await this.api.get('/plans');
    this.plansProblem = response.ok ? null : response.problem;
    if (response.ok) this.plans = response.value.plans;
  }

  setParameter(name: string, value: number): void {
    this.parameters = [...this.parameters.filter((each) => each.name !== name), { name, value }];
  }

  removeParameter(name: string): void {
    this.parameters = this.parameters.filter((each) => each.name !== name);
  }

  body(from_s: number): RerunBody {
    const [north, east] = [Number(this.windNorth), Number(this.windEast)];
    const hasWind = this.windNorth.trim() !== '' || this.windEast.trim() !== '';
    const motor = this.stoppedMotor;
    const metres = [Number(this.movedNorth), Number(this.movedEast), -Number(this.movedUp) || 0];
    const moved_ned_m = metres.every((each) => each === 0) ? null : metres;
    const common = {
      from_s,
      duration_s: Number(this.duration),
      parameters: Object.fromEntries(this.parameters.map(({ name, value }) => [name, value])),
      wind_ned_m_s: hasWind ? [north, east, 0] : null,
      motor_health: motor === 0 ? null : [1, 2, 3, 4].map((each) => (each === motor ? 0 : 1)),
    };
    if (this.kind === 'control') return { ...common, moved_ned_m };
    const by = { ...common, flown_by: 'autopilot' as const, plan: this.plan === '' ? null : this.plan };
    if (this.kind === 'failsafe') return { ...by, battery_percent: numberOf(this.battery), lost: this.lost === '' ? [] : [this.lost] };
    if (this.isOfMission) {
      const step = { place: placeOf(this.step), point: numberOf(this.point), moved_ned_m };
      return { ...by, step: { ...step, speed_m_s: numberOf(this.speed), duration_s: numberOf(this.stepDuration) } };
    }
    return { ...by, item: { number: Number(this.item), moved_ned_m, speed_m_s: numberOf(this.speed), then: this.then === '' ? null : this.then } };
  }

  /** Flies from a time of the plots. */
  async fly(from_s: number): Promise<void> {
    const { log } = this;
    if (log === undefined || this.isBusy) return;
    const { file, offset_s } = log;
    const request = ++this.request;
    this.isBusy = true;
    const response = await this.api.post('/flights/{f}/rerun', { params: { path: { f: file } }, body: this.body(from_s - offset_s) });
    if (request !== this.request || this.log?.file !== file) return; // another flight was opened
    this.isBusy = false;
    this.problem = response.ok ? null : response.problem;
    if (!response.ok) return;
    this.result = response.value;
    this.offset_s = offset_s;
    const t_s = response.value.t_s.map((at_s) => at_s + offset_s);
    const path = ({ position_ned_m }: Track, tone: RerunPath['tone'], id: string): RerunPath => ({
      t_s: t_s.slice(0, position_ned_m.length),
      position_ned_m,
      tone,
      id,
    });
    this.paths = [path(response.value.unchanged, 'id2', 'unchanged'), path(response.value.changed, 'id3', 'changed')];
    const { series, panes } = plotsOf({ ...response.value, t_s });
    this.view.showComputed(series, panes, { from_s: t_s[0] ?? from_s, to_s: t_s.at(-1) ?? from_s });
  }
}

type Component = (track: Track) => readonly number[];
const column =
  (rows: (track: Track) => readonly (readonly number[])[], index: number, sign = 1): Component =>
  (track) =>
    rows(track).map((row) => sign * (row[index] ?? NaN));
const position = (track: Track): readonly (readonly number[])[] => track.position_ned_m;
const attitude = (track: Track): readonly (readonly number[])[] => track.attitude_deg;

/** The panes of a rerun: how far it is from the log, then each value as logged, unchanged and changed. */
export function plotsOf(result: Rerun): { series: Series[]; panes: string[][] } {
  const rows: readonly { name: string; unit: string; of: Component }[] = [
    { name: 'North', unit: 'm', of: column(position, 0) },
    { name: 'East', unit: 'm', of: column(position, 1) },
    { name: 'Height', unit: 'm', of: column(position, 2, -1) },
    { name: 'Roll', unit: '°', of: column(attitude, 0) },
    { name: 'Pitch', unit: '°', of: column(attitude, 1) },
  ];
  const tracks: readonly { label: (name: string) => string; track: Track }[] = [
    { label: (name) => `${name}, logged`, track: result.logged },
    { label: (name) => `${name}, unchanged`, track: result.unchanged },
    { label: (name) => `${name}, changed`, track: result.changed },
  ];
  const { t_s } = result;
  const made = (label: string, unit: string, values: readonly number[]): Series => ({
    field: `${RERUN}${label}`,
    unit,
    samples: values.length,
    t_s: t_s.slice(0, values.length),
    values: [...values],
  });
  const error = made('Distance of the unchanged flight from the log', 'm', result.error_m);
  const groups = rows.map(({ name, unit, of }) => tracks.map(({ label, track }) => made(label(name), unit, of(track))));
  return { series: [error, ...groups.flat()], panes: [[error.field], ...groups.map((group) => group.map(({ field }) => field))] };
}

/** The largest distance of two tracks [m]. */
export function apart_m(first: Track, second: Track): number {
  return Math.max(0, ...first.position_ned_m.map((at, i) => Math.hypot(...at.map((value, k) => value - (second.position_ned_m[i]?.[k] ?? value)))));
}
