/** Set-up of a vehicle's gimbal: what is set, what is missing, and the values that a person has entered and not written. */

import { ofVehicle, type ApiClient } from '../../../api/client';
import type { Problem } from '../../../api/problems';
import type { components } from '../../../api/schema';
import { commandTo, type FixedVehicles } from '../../../app/actions/command.svelte';
import type { ActionController } from '../../../app/actions/controller.svelte';
import type { ParamChanges } from '../../../app/param-changes/changes.svelte';
import type { VehicleFacts } from '../../../vehicle/facts';
import { gimbalKey, gimbalParams } from '../../../vehicle/gimbal';
import { LatestSender } from '../control.svelte';

export type Setup = components['schemas']['GimbalSetup'];
export type Output = Setup['outputs'][number];
export type Finding = Setup['findings'][number];
export type Parameter = components['schemas']['ParameterView'];
export type Axis = 'roll' | 'pitch' | 'yaw';
export const AXES: readonly Axis[] = ['roll', 'pitch', 'yaw'];
export type Pose = components['schemas']['PoseRequest']['pose'];
/** Part of the page that shows the refusals of the set-up. */
export const PART = 'gimbal-setup';

const POLL_MS = 1000;

/** The parameter of a list, by name. */
export function byName(parameters: readonly Parameter[]): ReadonlyMap<string, Parameter> {
  return new Map(parameters.map((parameter) => [parameter.name, parameter]));
}

/**
 * The values that make `chosen` the only output of an axis (null: none). Outputs that drove the axis are disabled.
 * @param entered values that a person has entered and not written.
 */
export function outputValues(outputs: readonly Output[], axis: Axis, chosen: string | null, functions: Setup['functions']): Record<string, number> {
  const values: Record<string, number> = {};
  for (const output of outputs) {
    if (output.function_param === chosen) values[output.function_param] = functions[axis] ?? 0;
    else if (output.axis === axis) values[output.function_param] = 0;
  }
  return values;
}

/** The bit mask of reversed outputs with one bit changed. */
export function reversedMask(mask: number, bit: number, isReversed: boolean): number {
  const without = Math.floor(mask / 2 ** bit) % 2 === 1 ? mask - 2 ** bit : mask;
  return isReversed ? without + 2 ** bit : without;
}

/** Why an output cannot be chosen for the gimbal; null: it can. A motor's output must not be taken by a slip. */
export function takenBy(output: Output): string | null {
  return output.function === 0 || output.axis !== null ? null : (output.function_label ?? `function ${output.function}`);
}

interface Shown {
  readonly vehicle: string;
  readonly setup: Setup | null;
  readonly parameters: ReadonlyMap<string, Parameter>;
  /** Why the set-up is not known. */
  readonly problem: Problem | null;
  /** Progress of reading the parameters; null: they are read. */
  readonly reading: string | null;
}

interface Trial {
  readonly facts: VehicleFacts;
  readonly fixed: FixedVehicles;
  readonly axis: Axis;
  readonly angle_deg: number;
  readonly whileArmed: boolean;
}

export class GimbalSetup {
  private shown = $state.raw<Shown | null>(null);
  /** Entered values by parameter, of one vehicle. */
  private draft = $state.raw<{ readonly vehicle: string; readonly values: Readonly<Record<string, number>> }>({ vehicle: '', values: {} });
  /** The angle that was last tried, by gimbal and axis. */
  private tried = $state.raw<Readonly<Record<string, number>>>({});
  private watchNumber = 0;
  private readonly sender = new LatestSender<Trial>((trial) => this.sendTrial(trial));

  constructor(
    private readonly api: ApiClient,
    private readonly actions: ActionController,
    readonly changes: ParamChanges,
  ) {}

  of(vehicle: string): Shown | null {
    return this.shown?.vehicle === vehicle ? this.shown : null;
  }

  /** Shows a vehicle's set-up until the returned function is called; reads its parameters first, if necessary. */
  watch(vehicle: string): () => void {
    const number = ++this.watchNumber;
    void this.poll(vehicle, number);
    return () => {
      if (number === this.watchNumber) this.watchNumber += 1;
    };
  }

  private async poll(vehicle: string, number: number): Promise<void> {
    if (this.shown?.vehicle !== vehicle) this.shown = { vehicle, setup: null, parameters: new Map(), problem: null, reading: null };
    let asked = false;
    while (number === this.watchNumber) {
      const isRead = await this.refresh(vehicle, number);
      if (!isRead && !asked && number === this.watchNumber) {
        asked = true;
        await this.api.post('/vehicles/{v}/params/refresh', ofVehicle(vehicle));
      }
      await new Promise((resolve) => setTimeout(resolve, POLL_MS));
    }
  }

  /** Reads the set-up again. @returns whether the vehicle's parameters have been read. */
  async refresh(vehicle: string, number = this.watchNumber): Promise<boolean> {
    const answer = await this.api.get('/vehicles/{v}/gimbal/setup', ofVehicle(vehicle));
    if (number !== this.watchNumber || this.shown?.vehicle !== vehicle) return true;
    if (!answer.ok) {
      this.shown = { ...this.shown, problem: answer.problem };
      return true;
    }
    const { setup, params, list } = answer.value;
    const progress = list.state === 'failed' ? (list.problem ?? 'failed') : `${list.received} of ${list.count ?? 'unknown'} …`;
    this.shown = { vehicle, setup, parameters: byName(params), problem: null, reading: setup === null ? `Reading the parameters: ${progress}` : null };
    return setup !== null || list.state === 'reading';
  }

  // --- entered values ----------------------------------------------------------------------------

  entered(vehicle: string): Readonly<Record<string, number>> {
    return this.draft.vehicle === vehicle ? this.draft.values : {};
  }

  /** The entered value of a parameter, or the vehicle's. */
  valueOf(vehicle: string, name: string): number | null {
    return this.entered(vehicle)[name] ?? this.of(vehicle)?.parameters.get(name)?.value ?? null;
  }

  /** Enters values; one that is the vehicle's is no change. */
  enter(vehicle: string, values: Readonly<Record<string, number>>): void {
    const all = { ...this.entered(vehicle), ...values };
    const changed = Object.entries(all).filter(([name, value]) => this.of(vehicle)?.parameters.get(name)?.value !== value);
    this.draft = { vehicle, values: Object.fromEntries(changed) };
  }

  discard(): void {
    this.draft = { vehicle: '', values: {} };
  }

  /** The outputs with the entered functions. */
  outputs(vehicle: string): readonly Output[] {
    const setup = this.of(vehicle)?.setup ?? null;
    if (setup === null) return [];
    const axisOf = (number: number): Axis | null => AXES.find((axis) => setup.functions[axis] === number) ?? null;
    return setup.outputs.map((output) => {
      const number = this.entered(vehicle)[output.function_param] ?? output.function;
      const mask = output.reverse_param === null ? null : this.valueOf(vehicle, output.reverse_param);
      const reversed = mask === null ? output.reversed : Math.floor(mask / 2 ** output.reverse_bit) % 2 === 1;
      return { ...output, function: number, axis: axisOf(number), reversed };
    });
  }

  /** Chooses the output of an axis; null: none. */
  chooseOutput(vehicle: string, axis: Axis, chosen: string | null): void {
    const setup = this.of(vehicle)?.setup ?? null;
    if (setup !== null) this.enter(vehicle, outputValues(this.outputs(vehicle), axis, chosen, setup.functions));
  }

  reverse(vehicle: string, output: Output, isReversed: boolean): void {
    if (output.reverse_param === null) return;
    this.enter(vehicle, { [output.reverse_param]: reversedMask(this.valueOf(vehicle, output.reverse_param) ?? 0, output.reverse_bit, isReversed) });
  }

  /** Opens the review of the entered values. */
  async review(facts: VehicleFacts): Promise<void> {
    const changes = Object.entries(this.entered(facts.id)).map(([name, value]) => ({ name, value }));
    await this.changes.review(facts, 'Gimbal set-up', { changes });
  }

  // --- commands ----------------------------------------------------------------------------------

  /** Writes the changes that mend a finding, as the finding shows them, and starts the gimbal module if it must be started. */
  async mend(facts: VehicleFacts, finding: Finding): Promise<void> {
    const parameters = this.of(facts.id)?.parameters;
    const fixed = this.actions.gate.fix([facts.id]);
    const changes = finding.changes.map(({ name, value }) => ({ name, old: parameters?.get(name)?.value ?? null, value }));
    if (changes.length > 0 && (await this.changes.writeChanges(facts.id, changes, {}, fixed)) !== true) return;
    if (finding.restarts) await this.callModule(facts, 'start', fixed);
    await this.refresh(facts.id);
  }

  /** Starts the gimbal module, or asks for its status. */
  async callModule(facts: VehicleFacts, action: 'start' | 'status', fixed = this.actions.gate.fix([facts.id])): Promise<void> {
    const name = action === 'start' ? 'Start the gimbal' : 'Status of the gimbal';
    const send = () => this.api.post('/vehicles/{v}/gimbal/module', { ...ofVehicle(facts.id), body: { action } });
    await this.actions.attempt(commandTo(facts, name, send), PART, fixed);
    await this.refresh(facts.id);
  }

  isStarting(vehicle: string): boolean {
    return ['Start the gimbal', 'Status of the gimbal'].some((name) => this.actions.gate.isWaiting({ name, vehicles: [vehicle] }));
  }

  async pose(facts: VehicleFacts, pose: Pose): Promise<void> {
    this.tried = {};
    const send = () => this.api.post('/vehicles/{v}/gimbal/pose', { ...gimbalParams(facts), body: { pose } });
    await this.actions.attempt(commandTo(facts, 'Move the gimbal', send, { part: gimbalKey(facts) }), PART);
  }

  triedAngle(facts: VehicleFacts, axis: Axis): number {
    return this.tried[`${gimbalKey(facts)} ${axis}`] ?? 0;
  }

  /** Turns one axis. While an answer is awaited only the newest angle is kept. */
  tryAxis(facts: VehicleFacts, axis: Axis, angle_deg: number, whileArmed: boolean): void {
    this.tried = { [`${gimbalKey(facts)} ${axis}`]: angle_deg };
    this.sender.push({ facts, fixed: this.actions.gate.fix([facts.id]), axis, angle_deg, whileArmed });
  }

  private async sendTrial({ facts, fixed, axis, angle_deg, whileArmed }: Trial): Promise<void> {
    const body = { axis, angle_deg, while_armed: whileArmed };
    const send = () => this.api.post('/vehicles/{v}/gimbal/try', { ...gimbalParams(facts), body });
    await this.actions.attempt(commandTo(facts, 'Try the gimbal', send, { part: gimbalKey(facts) }), PART, fixed);
  }
}
