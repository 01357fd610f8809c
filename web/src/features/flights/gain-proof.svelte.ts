/** Proof of gains: proposed values are flown a hundred times in simulation before they may be written to a vehicle. */

import type { ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import { follow, type Operation } from '../../app/follow';
import { fixed } from '../../ui/format';
import type { ChangedParameter } from './what-if.svelte';

type Schemas = components['schemas'];
export type Proof = Schemas['Proof'];
type Pair = Schemas['ProofPair'];
type Failure = Schemas['ProofRun']['failures'][number];
/** Runs that a proof has before its values may be written. */
const RUNS = 100;
const MAX_FAILED = 5;

export class GainProof {
  parameters = $state.raw<readonly ChangedParameter[]>([]);
  operation = $state.raw<Operation | null>(null);
  result = $state.raw<Proof | null>(null);
  problem = $state.raw<Pick<Problem, 'title' | 'detail'> | null>(null);
  isStarting = $state(false);

  constructor(private readonly api: ApiClient) {}

  readonly isRunning: boolean = $derived.by(() => this.isStarting || this.operation?.state === 'running');

  set(name: string, value: number): void {
    this.parameters = [...this.parameters.filter((each) => each.name !== name), { name, value }];
  }

  /** Proposes these values instead of all that were. */
  setAll(values: readonly ChangedParameter[]): void {
    this.parameters = values.map(({ name, value }) => ({ name, value }));
  }

  remove(name: string): void {
    this.parameters = this.parameters.filter((each) => each.name !== name);
  }

  /** Whether exactly the shown values passed for this vehicle. */
  isProvedFor(vehicle: string | null): boolean {
    const { result, parameters } = this;
    return result !== null && result.passed && result.runs >= RUNS && result.vehicle === vehicle && isOf(result, parameters);
  }

  /** The result, if it is of the shown values and this vehicle. */
  resultFor(vehicle: string | null): Proof | null {
    const { result } = this;
    return result !== null && result.vehicle === vehicle && isOf(result, this.parameters) ? result : null;
  }

  /** Proves the shown values for a vehicle. */
  async prove(vehicle: string): Promise<void> {
    if (this.isRunning || this.parameters.length === 0) return;
    this.isStarting = true;
    this.problem = this.result = null;
    const parameters = Object.fromEntries(this.parameters.map(({ name, value }) => [name, value]));
    const begun = await this.api.post('/proofs', { body: { vehicle, parameters, runs: RUNS, seed: 0 } });
    this.isStarting = false;
    if (!begun.ok) {
      this.problem = begun.problem;
      return;
    }
    const ended = await follow(this.api, begun.value, (operation) => {
      this.operation = operation;
      return true;
    });
    if (ended.error !== null) this.problem = ended.error;
    const id = ended.result?.['proof'];
    if (ended.state !== 'succeeded' || typeof id !== 'string') return;
    const response = await this.api.get('/proofs/{p}', { params: { path: { p: id } } });
    if (response.ok) this.result = response.value;
    else this.problem = response.problem;
  }

  async cancel(): Promise<void> {
    if (this.operation === null) return;
    const response = await this.api.delete('/operations/{o}', { params: { path: { o: this.operation.id } } });
    if (!response.ok) this.problem = response.problem;
  }
}

function isOf({ parameters }: Proof, shown: readonly ChangedParameter[]): boolean {
  return Object.keys(parameters).length === shown.length && shown.every(({ name, value }) => parameters[name] === value);
}

const FAILURES: Readonly<Record<Failure, () => string>> = {
  crashed: () => 'loses control',
  oscillates: () => 'oscillates in hover',
  tracking: () => 'does not tilt as wanted',
  saturated: () => 'drives motors to their limits',
  altitude: () => 'does not hold its altitude',
  position: () => 'does not hold its position',
};

/** What went wrong in a run, as words; empty: it was stable. */
export function failureText(failures: readonly Failure[]): string {
  return failures.map((each) => FAILURES[each]()).join(', ');
}

/** The runs that are not stable with the proposed values, at most five. */
export function failedPairs({ pairs }: Proof): readonly Pair[] {
  return pairs.filter(({ proposed }) => proposed.failures.length > 0).slice(0, MAX_FAILED);
}

export function worstPair({ pairs, worst }: Proof): Pair | null {
  return pairs[worst - 1] ?? null;
}

/** The conditions of a run, as words. */
export function conditionsText({ conditions }: Pair): string {
  const { wind_ne_m_s, gusts_m_s, mass, thrust, inertia, lag } = conditions;
  const wind_m_s = Math.hypot(...wind_ne_m_s);
  const percent = (factor: number): string => `${fixed(100 * (factor - 1), 0, true)} %`;
  const turns = inertia.map(percent).join(' / ');
  return `wind ${fixed(wind_m_s, 1)} m/s, gusts ${fixed(gusts_m_s, 1)} m/s, mass ${percent(mass)}, thrust ${percent(thrust)}, inertia ${turns}, motor lag ${percent(lag)}`;
}
