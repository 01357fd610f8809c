/** Tuning: how the rate and attitude loops of the open log follow their setpoints. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import type { Window } from '../../plots/plot-view.svelte';
import { fixed } from '../../ui/format';
import type { LogView } from './log-view.svelte';

type Schemas = components['schemas'];
export type LoopResponse = Schemas['LoopResponse'];
export type Autotune = Schemas['Autotune'];
/** Gain and phase of a frequency with less coherence mean nothing. */
const LEAST_COHERENCE = 0.5;

export class Tuning {
  loops = $state.raw<readonly LoopResponse[]>([]);
  /** What PX4's autotune found in the flight; null: it did not run. */
  autotune = $state.raw<Autotune | null>(null);
  isBusy = $state(false);
  problem = $state.raw<Pick<Problem, 'title' | 'detail'> | null>(null);
  private request = 0;

  constructor(
    private readonly api: ApiClient,
    private readonly view: LogView,
  ) {}

  /** Place of the vehicle's own log among the parts of the open flight; -1: there is none. */
  get logIndex(): number {
    return this.view.parts.findIndex(({ overview }) => overview.kind === 'ulog');
  }

  /** Forgets what was found, as it is of another log. */
  reset(): void {
    this.request += 1;
    this.loops = [];
    this.autotune = null;
    this.isBusy = false;
    this.problem = null;
  }

  /** Finds the responses in a part of the flight. */
  async load({ from_s, to_s }: Window): Promise<void> {
    const part = this.view.parts[this.logIndex];
    if (part === undefined) return;
    const request = ++this.request;
    this.isBusy = true;
    const query = { from_s: from_s - part.offset_s, to_s: to_s - part.offset_s };
    const response = await this.api.get('/flights/{f}/loops', { params: { path: { f: part.file }, query } });
    if (request !== this.request) return; // another part or flight
    this.isBusy = false;
    this.problem = response.ok ? null : response.problem;
    if (response.ok) ({ loops: this.loops, autotune: this.autotune } = response.value);
  }

  /** Shows setpoint and measurement of a loop in the plots. */
  show({ setpoint, measured }: LoopResponse): void {
    const index = this.logIndex;
    if (index < 0 || setpoint === '') return;
    this.view.showPanes([{ fields: [measured, setpoint].map((field) => (index === 0 ? field : `${index}|${field}`)) }]);
  }
}

export function loopName({ loop, axis }: Pick<LoopResponse, 'loop' | 'axis'>): string {
  if (loop === 'rate') return axis === 'roll' ? 'Roll rate' : axis === 'pitch' ? 'Pitch rate' : 'Yaw rate';
  return axis === 'roll' ? 'Roll angle' : axis === 'pitch' ? 'Pitch angle' : 'Yaw angle';
}

const milliseconds = (seconds: number): string => `${Math.round(1000 * seconds)} ms`;
const percent = (part: number): string => `${Math.round(100 * part)} %`;
const between = ([low, high]: readonly number[], text: (value: number) => string): string => `${text(low ?? 0)}–${text(high ?? 0)}`;

/** What the log says of a loop, in sentences; the first is the shortest answer. */
export function sentencesOf({ step, frequency }: LoopResponse): string[] {
  const said: string[] = [];
  if (step !== null) {
    said.push(
      step.overshoot < 0.01
        ? `Rises in ${milliseconds(step.rise_s)}, without overshoot.`
        : `Rises in ${milliseconds(step.rise_s)}, overshoots by ${percent(step.overshoot)}.`,
    );
    said.push(
      step.settling_s === null ? 'It does not settle within the shown time.' : `It stays within 5 % of its final value after ${milliseconds(step.settling_s)}.`,
    );
    if (Math.abs(step.final - 1) > 0.1) said.push(`It ends at ${percent(step.final)} of the setpoint.`);
    if (step.rise_range_s !== null && step.overshoot_range !== null)
      said.push(`In parts of the flight it rises in ${between(step.rise_range_s, milliseconds)} and overshoots by ${between(step.overshoot_range, percent)}.`);
  }
  if (frequency !== null) {
    if (frequency.bandwidth_hz !== null)
      said.push(`Bandwidth ${frequency.bandwidth_hz.toFixed(1)} Hz (−3 dB), phase ${fixed(frequency.phase_at_bandwidth_deg, 0)}° there.`);
    if (frequency.peak_db >= 1) said.push(`It answers strongest at ${frequency.peak_hz.toFixed(1)} Hz: ${frequency.peak_db.toFixed(1)} dB above the setpoint.`);
  }
  return said;
}

/** Values of the frequencies that mean something; null between them. */
export function coherent(values: readonly number[], coherence: readonly number[]): (number | null)[] {
  return values.map((value, i) => ((coherence[i] ?? 0) >= LEAST_COHERENCE ? value : null));
}

/** The gains of autotune beside those of the log, in the order of roll, pitch, yaw. */
export function autotuneRows(
  { axes }: Autotune,
  present: readonly { readonly name: string; readonly value: number }[],
): { name: string; value: number; present: number | null }[] {
  const known = new Map(present.map(({ name, value }) => [name, value]));
  return axes.flatMap(({ parameters }) => Object.entries(parameters).map(([name, value]) => ({ name, value, present: known.get(name) ?? null })));
}
