/** The list of modes of one vehicle, and their selection. */

import { ofVehicle, type ApiClient } from '../../api/client';
import type { Problem } from '../../api/problems';
import { commandTo } from '../../app/actions/command.svelte';
import { MAIN_PART, type ActionController } from '../../app/actions/controller.svelte';
import type { VehicleFacts } from '../../vehicle/facts';
import { actionOf, modeTexts, type ModeChoice, type ModeRow } from './mode-texts';

interface ModeList {
  readonly vehicle: string;
  /** Null until the server has answered. */
  readonly modes: readonly ModeChoice[] | null;
  /** Whether the list is the vehicle's own. */
  readonly ofVehicle: boolean;
  readonly problem: Problem | null;
}

export class ModeMenu {
  private list = $state.raw<ModeList | null>(null);
  private request = 0;

  constructor(
    private readonly api: ApiClient,
    private readonly actions: ActionController,
    /** The vehicle's present state; null: it was removed. */
    private readonly factsNow: (id: string) => VehicleFacts | null,
  ) {}

  /** The list of a vehicle; null: not read yet. */
  listOf(vehicle: string): ModeList | null {
    return this.list?.vehicle === vehicle ? this.list : null;
  }

  /** Reads the list from the server. A later call replaces an earlier one. */
  async read(vehicle: string): Promise<void> {
    const request = ++this.request;
    const known = this.listOf(vehicle);
    if (known === null) this.list = { vehicle, modes: null, ofVehicle: false, problem: null };
    const answer = await this.api.get('/vehicles/{v}/modes', ofVehicle(vehicle));
    if (request !== this.request) return;
    this.list = answer.ok
      ? { vehicle, modes: answer.value.modes, ofVehicle: answer.value.of_vehicle, problem: null }
      : { vehicle, modes: known?.modes ?? null, ofVehicle: known?.ofVehicle ?? false, problem: answer.problem };
  }

  /** Selects a mode: at once if it is Hold, otherwise after a confirmation that says what the vehicle does in it. */
  choose(row: ModeRow, facts: VehicleFacts): void {
    const action = actionOf(row.mode);
    if (action !== null) return this.actions.request(action, facts, MAIN_PART);
    const { id, name, inAir } = facts;
    const isChanged = (): boolean => (this.factsNow(id)?.inAir ?? inAir) !== inAir;
    const changed = (): string | null => (isChanged() ? `${name} has ${inAir ? 'landed' : 'taken off'} since the command was given.` : null);
    const send = (despite: readonly string[]) =>
      this.api.post('/vehicles/{v}/mode', { ...ofVehicle(id), body: { mode: row.mode, ...(despite.length === 0 ? {} : { despite }) } });
    const texts = () => modeTexts(row, this.factsNow(id) ?? facts);
    this.actions.requestCommand({ ...commandTo(facts, `Mode ${row.label}`, send, { changed, acceptsFindings: true }), texts }, MAIN_PART);
  }
}
