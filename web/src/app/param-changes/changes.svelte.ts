/**
 * Changes several parameters of a vehicle: the server compares wanted values with the vehicle's, a person looks at the rows, and only
 * what was shown is written. The review belongs to the vehicle for which it was opened; it is closed when this vehicle changes.
 */

import { ofVehicle, type ApiClient, type Outcome } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import { DOUBLE_CLICK, type CommandGate, type FixedVehicles } from '../actions/command.svelte';

export type ReviewRow = components['schemas']['ReviewRow'];
export type Changes = components['schemas']['ChangesView'];
type Written = NonNullable<Changes['last']>;
/** What to compare with the vehicle's parameters. */
export type ReviewSource = Omit<components['schemas']['ReviewRequest'], 'force'>;

const POLL_MS = 250;
const WRITE = 'Write parameters';
const REVIEW = 'Review of parameters';
const RESTART = 'Restart';

interface Review {
  readonly vehicle: string;
  readonly name: string;
  /** What it compares with, as a text. */
  readonly title: string;
  readonly rows: readonly ReviewRow[];
  /** What to know before writing, such as a file of another vehicle. */
  readonly notes: readonly string[];
  readonly undo: boolean;
  readonly fixed: FixedVehicles;
}

interface Result {
  readonly vehicle: string;
  readonly written: Written;
}

/** Whether a row of a review can be written. */
export const isChange = (row: ReviewRow): boolean => row.state === 'change' && row.new !== null;

/** The rows that a person may have to look at, refused ones first. */
export function sortedRows(rows: readonly ReviewRow[]): ReviewRow[] {
  const rank = { refused: 0, change: 1, same: 2 } as const;
  return [...rows].sort((a, b) => rank[a.state] - rank[b.state]);
}

/** A number of a row with its label and unit. */
export function cellText(value: number | null, label: string | null, unit: string | null): string {
  if (value === null) return '–';
  const number = String(Number(value.toPrecision(7))).replace('-', '−');
  if (label !== null) return `${label} (${number})`;
  return unit === null ? number : `${number} ${unit}`;
}

/** The result of a writing in words. */
export function resultText({ rows, stopped }: Written): string {
  const count = (state: Written['rows'][number]['state']): number => rows.filter((row) => row.state === state).length;
  const parts = [`${count('set')} of ${rows.length} written`];
  if (count('not_taken') > 0) parts.push(`${count('not_taken')} not taken by the vehicle`);
  if (count('no_answer') > 0) parts.push(`${count('no_answer')} without an answer`);
  if (count('not_written') > 0) parts.push(`${count('not_written')} not written`);
  return `${parts.join(', ')}.${stopped === null ? '' : ` ${stopped}`}`;
}

export class ParamChanges {
  private openReview = $state.raw<Review | null>(null);
  /** Names of the rows that are to be written. */
  chosen = $state.raw<ReadonlySet<string>>(new Set());
  private lastProblem = $state.raw<{ readonly vehicle: string; readonly problem: Problem } | null>(null);
  private lastResult = $state.raw<Result | null>(null);
  /** Progress of a writing, by vehicle. */
  private progress = $state.raw<Readonly<Record<string, string>>>({});
  private reading = $state.raw<{ readonly vehicle: string; readonly other: string } | null>(null);
  private restarted = $state.raw<Readonly<Record<string, boolean>>>({});

  constructor(
    private readonly api: ApiClient,
    private readonly gate: CommandGate,
  ) {}

  /** The open review of this vehicle; null: none, or the vehicle has changed since. */
  reviewOf(vehicle: string): Review | null {
    const review = this.openReview;
    return review !== null && review.vehicle === vehicle && review.fixed.problem() === null ? review : null;
  }

  problemOf(vehicle: string): Problem | null {
    return this.lastProblem?.vehicle === vehicle ? this.lastProblem.problem : null;
  }

  resultOf(vehicle: string): Written | null {
    return this.lastResult?.vehicle === vehicle ? this.lastResult.written : null;
  }

  /** What is being written; null: nothing. */
  progressOf(vehicle: string): string | null {
    return this.progress[vehicle] ?? null;
  }

  /** Whether this page has restarted the vehicle since the last writing. */
  hasRestarted(vehicle: string): boolean {
    return this.restarted[vehicle] === true;
  }

  isReviewing(vehicle: string): boolean {
    return this.gate.isWaiting({ name: REVIEW, vehicles: [vehicle] });
  }

  close(): void {
    this.openReview = null;
  }

  toggle(name: string, isChosen: boolean): void {
    this.chosen = new Set(isChosen ? [...this.chosen, name] : [...this.chosen].filter((each) => each !== name));
  }

  /**
   * Compares, and opens the review. Nothing is written.
   * @param isEachMeant whether a person has named each parameter; of whole sets those are not chosen that another vehicle should hardly take over.
   */
  async review(
    { id, name }: { readonly id: string; readonly name: string },
    title: string,
    source: ReviewSource,
    isEachMeant = source.changes != null || source.undo === true,
  ): Promise<boolean> {
    this.openReview = this.lastProblem = this.lastResult = null;
    const outcome = await this.gate.run({ name: REVIEW, vehicles: [id] }, async (fixed) => {
      const answer = await this.api.post('/vehicles/{v}/param_changes/review', { ...ofVehicle(id), body: { force: false, ...source } });
      return answer.ok ? ({ ok: true, value: { ...answer.value, fixed } } as const) : answer;
    });
    if (!outcome.ok) {
      this.fail(id, outcome.problem);
      return false;
    }
    const { rows, notes, fixed } = outcome.value;
    this.openReview = { vehicle: id, name, title, notes, rows: sortedRows(rows), undo: source.undo === true, fixed };
    this.chosen = new Set(rows.filter((row) => isChange(row) && (isEachMeant || !(row.volatile || row.individual))).map((row) => row.name));
    return true;
  }

  /** The other vehicle whose parameters are read for a comparison; null: none. */
  readingFor(vehicle: string): string | null {
    return this.reading?.vehicle === vehicle ? this.reading.other : null;
  }

  /** Compares with another vehicle, whose parameters the server reads first. */
  async compareWith(facts: { readonly id: string; readonly name: string }, other: string, otherName: string): Promise<void> {
    this.reading = { vehicle: facts.id, other };
    await this.api.post('/vehicles/{v}/params/refresh', { ...ofVehicle(other), body: { ignore_cache: false, wait: true } });
    if (this.reading?.vehicle !== facts.id || this.reading.other !== other) return;
    this.reading = null;
    await this.review(facts, `Parameters of ${otherName}`, { of_vehicle: other });
  }

  /** The chosen changes of the open review. */
  chosenRows(vehicle: string): readonly ReviewRow[] {
    return this.reviewOf(vehicle)?.rows.filter((row) => isChange(row) && this.chosen.has(row.name)) ?? [];
  }

  /** Writes the chosen changes of the open review. @returns whether all were written. */
  async write(vehicle: string, whileArmed: boolean): Promise<boolean> {
    const review = this.openReview;
    if (review?.vehicle !== vehicle) return false;
    const problem = review.fixed.problem();
    if (problem !== null) {
      this.openReview = null;
      this.fail(vehicle, problem);
      return false;
    }
    const rows = this.chosenRows(vehicle);
    if (rows.length === 0) return false;
    const changes = rows.map(({ name, old, new: value }) => ({ name, old, value: value ?? 0 }));
    const isWritten = await this.writeChanges(review.vehicle, changes, { undo: review.undo, while_armed: whileArmed }, review.fixed);
    if (this.openReview === review && isWritten !== null) this.openReview = null;
    return isWritten === true;
  }

  /** Writes changes that a person has seen with their old values. @returns whether all were written; null: nothing was written. */
  async writeChanges(
    vehicle: string,
    changes: readonly { readonly name: string; readonly old: number | null; readonly value: number }[],
    options: { readonly undo?: boolean; readonly while_armed?: boolean } = {},
    fixed = this.gate.fix([vehicle]),
  ): Promise<boolean | null> {
    this.lastProblem = this.lastResult = null;
    const { [vehicle]: _, ...others } = this.restarted;
    this.restarted = others;
    const outcome = await this.gate.run(
      { name: WRITE, vehicles: [vehicle] },
      async (): Promise<Outcome<Written>> => {
        const body = { changes: [...changes], force: false, undo: false, while_armed: false, ...options, wait: false };
        const started = await this.api.post('/vehicles/{v}/param_changes/apply', { ...ofVehicle(vehicle), body });
        if (!started.ok) return started;
        return this.follow(vehicle, started.value.operation ?? '');
      },
      fixed,
    );
    const { [vehicle]: __, ...left } = this.progress;
    this.progress = left;
    if (!outcome.ok) {
      this.fail(vehicle, outcome.problem);
      return null;
    }
    this.lastResult = { vehicle, written: outcome.value };
    return outcome.value.rows.every((row) => row.state === 'set');
  }

  /** Follows the writing until its end. */
  private async follow(vehicle: string, operation: string): Promise<Outcome<Written>> {
    for (;;) {
      const state = await this.api.get('/operations/{o}', { params: { path: { o: operation } } });
      if (!state.ok) return state;
      if (state.value.state === 'running') {
        this.progress = { ...this.progress, [vehicle]: state.value.text };
        await new Promise((resolve) => setTimeout(resolve, POLL_MS));
        continue;
      }
      const { error } = state.value;
      if (error !== null) return { ok: false, problem: { reasons: [], remedy: null, field: null, ...error } as unknown as Problem };
      const changes = await this.api.get('/vehicles/{v}/param_changes', ofVehicle(vehicle));
      if (!changes.ok) return changes;
      const { last } = changes.value;
      if (state.value.state === 'succeeded' && last !== null) return { ok: true, value: last };
      const detail = `Writing ended early: ${state.value.text}`;
      return { ok: false, problem: { title: 'Not all written', detail, reasons: [], remedy: 'Review again.', code: 'cancelled', status: 0, field: null } };
    }
  }

  /** Restarts the vehicle, so that changed parameters take effect. */
  async restart(vehicle: string): Promise<void> {
    this.lastProblem = null;
    const outcome = await this.gate.run({ name: RESTART, vehicles: [vehicle] }, () =>
      this.api.post('/vehicles/{v}/restart', { ...ofVehicle(vehicle), body: { confirm: `vehicle ${vehicle} restarts` } }),
    );
    if (outcome.ok) this.restarted = { ...this.restarted, [vehicle]: true };
    else this.fail(vehicle, outcome.problem);
  }

  /** Shows why something else failed about the parameters of a vehicle. */
  show(vehicle: string, problem: Problem): void {
    this.fail(vehicle, problem);
  }

  private fail(vehicle: string, problem: Problem): void {
    if (problem.code !== DOUBLE_CLICK) this.lastProblem = { vehicle, problem };
  }
}
