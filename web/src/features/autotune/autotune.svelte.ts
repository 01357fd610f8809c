/** PX4's autotune of a vehicle: whether it can start, its start after a confirmation, its progress, and its end. */

import { ofVehicle, type ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { components } from '../../api/schema';
import { commandTo } from '../../app/actions/command.svelte';
import type { ConfirmationTexts } from '../../app/actions/actions';
import type { ActionController } from '../../app/actions/controller.svelte';
import type { Operation } from '../../app/follow';
import type { ParamChanges } from '../../app/param-changes/changes.svelte';
import type { VehicleFacts } from '../../vehicle/facts';

export type AutotuneState = components['schemas']['AutotuneState'];
/** Part of the page that shows the refusals of autotune. */
export const PART = 'autotune';
const POLL_MS = 1000;
/** The vehicle is asked for its settings once in so many looks at the operation. */
const LOOKS = 3;

/** The finding that a person accepts with the confirmation, which says it. */
const APPLIES: Readonly<Record<number, string>> = { 1: 'autotune_applies_after_disarming', 2: 'autotune_applies_in_flight' };

interface Shown {
  readonly vehicle: string;
  readonly state: AutotuneState | null;
  /** Why the state is not known. */
  readonly problem: Problem | null;
  /** The newest autotune of this vehicle, running or ended, whoever started it; null: none since the server's start. */
  readonly operation: Operation | null;
}

/** What becomes of the gains, as a sentence. */
export function applyText(apply: number | null): string {
  if (apply === 0) return 'The gains are only in the log of the flight: prove them there before you write them.';
  if (apply === 1) return 'The vehicle writes the gains itself once it is disarmed, without a proof.';
  if (apply === 2) return 'The vehicle writes the gains itself in flight, without a proof, and may become unstable.';
  return 'What becomes of the gains is not known.';
}

export function confirmationTexts(facts: VehicleFacts, apply: number | null): ConfirmationTexts {
  const mode = facts.status?.value.mode_label ?? '–';
  return {
    title: `Autotune: ${facts.name}`,
    effect: `Shakes itself about roll, pitch and yaw for 40 to 70 s, in ${mode}. Needs room, and 4 to 20 m of height. Goes on without this page or a link; another mode or a stick ends it. ${applyText(apply)}`,
    verb: 'Start',
    danger: apply !== 0,
  };
}

/** How autotune has ended, as a sentence; null: it runs, or its error says it. */
export function outcomeText({ state, result }: Operation): string | null {
  if (state !== 'succeeded') return null;
  if (result?.['outcome'] === 'waits_for_disarming')
    return 'Autotune has found gains. The vehicle writes them when it is disarmed: take off carefully afterwards.';
  return result?.['apply'] === 0
    ? 'Autotune has found gains. They are in the log of this flight: after the landing, open it in Flights, and prove them under Tuning.'
    : 'Autotune has found gains, and the vehicle has written and tested them.';
}

export class AutotuneControl {
  private shown = $state.raw<Shown | null>(null);
  private watchNumber = 0;

  constructor(
    private readonly api: ApiClient,
    private readonly actions: ActionController,
    private readonly factsNow: (id: string) => VehicleFacts | null,
    readonly changes: ParamChanges,
  ) {}

  of(vehicle: string): Shown | null {
    return this.shown?.vehicle === vehicle ? this.shown : null;
  }

  /** Shows a vehicle's autotune until the returned function is called. */
  watch(vehicle: string): () => void {
    const number = ++this.watchNumber;
    void this.poll(vehicle, number);
    return () => {
      if (number === this.watchNumber) this.watchNumber += 1;
    };
  }

  private async poll(vehicle: string, number: number): Promise<void> {
    this.shown = { vehicle, state: null, problem: null, operation: null };
    for (let look = 0; number === this.watchNumber; look++) {
      await this.refreshOperation(vehicle, number);
      if (look % LOOKS === 0 && this.of(vehicle)?.operation?.state !== 'running') await this.refreshState(vehicle, number);
      await new Promise((resolve) => setTimeout(resolve, POLL_MS));
    }
  }

  private async refreshOperation(vehicle: string, number: number): Promise<void> {
    const answer = await this.api.get('/operations', { params: { query: { vehicle } } });
    if (!answer.ok || number !== this.watchNumber || this.shown?.vehicle !== vehicle) return;
    const operation = answer.value.operations.filter(({ kind }) => kind === 'autotune').at(-1) ?? null;
    const hasEnded = operation?.state !== 'running' && this.shown.operation?.state === 'running';
    this.shown = { ...this.shown, operation };
    if (hasEnded) await this.refreshState(vehicle, number);
  }

  private async refreshState(vehicle: string, number: number): Promise<void> {
    const answer = await this.api.get('/vehicles/{v}/autotune', ofVehicle(vehicle));
    if (number !== this.watchNumber || this.shown?.vehicle !== vehicle) return;
    this.shown = answer.ok ? { ...this.shown, state: answer.value, problem: null } : { ...this.shown, problem: answer.problem };
  }

  /** Opens the confirmation, which says what the vehicle does and what becomes of the gains. */
  start(facts: VehicleFacts): void {
    const { id } = facts;
    const apply = this.of(id)?.state?.apply ?? null;
    const said = apply === null ? undefined : APPLIES[apply];
    const present = (): VehicleFacts => this.factsNow(id) ?? facts;
    const command = commandTo(
      facts,
      'Autotune',
      (accepted) => {
        const despite = [...(said === undefined ? [] : [said]), ...accepted];
        return this.api.post('/vehicles/{v}/autotune', { ...ofVehicle(id), body: { despite } });
      },
      {
        acceptsFindings: true,
        changed: () =>
          present().status?.value.mode === facts.status?.value.mode ? null : `The mode of ${facts.name} has changed since the command was given.`,
      },
    );
    this.actions.requestCommand({ ...command, texts: () => confirmationTexts(present(), apply) }, PART);
  }

  /** Ends autotune by a change of the mode. */
  end(facts: VehicleFacts): Promise<boolean> {
    const command = commandTo(facts, 'End autotune', () => this.api.delete('/vehicles/{v}/autotune', ofVehicle(facts.id)), { stops: true });
    return this.actions.attempt(command, PART);
  }

  /** Opens the review of one parameter. */
  async propose(facts: VehicleFacts, name: 'MC_AT_APPLY' | 'MC_AT_EN', value: number): Promise<void> {
    await this.changes.review(facts, 'Autotune', { changes: [{ name, value }] });
  }

  async takeBack(facts: VehicleFacts): Promise<void> {
    await this.changes.review(facts, 'Undo the newest change', { undo: true });
  }
}
