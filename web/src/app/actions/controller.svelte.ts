/** Asks for confirmation, sends commands, and shows a refusal beside the button that was pressed. */

import type { VehicleFacts } from '../../vehicle/facts';
import type { ApiClient, Outcome } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { WireEvent } from '../../live/wire';
import { controlProblem, otherControlHolder } from '../../vehicle/control';
import {
  actionFacts,
  ACTION_NAMES,
  confirmationTexts,
  sendAction,
  reasonUnavailable,
  type ActionFacts,
  type ActionName,
  type ConfirmationTexts,
  type GotoTarget,
} from './actions';
import type { StreamStart } from '../../vehicle/setpoint';
import { ConfirmationSlider } from './confirmation';

/** The part of the page that contains the pressed button and shows the refusal. `stage`: map and 3D view; `offboard`: the offboard card. */
export type PagePart = 'actionBar' | 'offboard' | 'offboardRoom' | 'gimbal' | 'camera' | 'stage' | 'control';

/** A command whose request and confirmation texts the caller provides, for example for a group or a mission. */
export interface CommandToConfirm {
  commandName: string;
  /** Name of the vehicle, or names of several vehicles as one text. */
  vehicleNames: string;
  /** Returns the present texts of the confirmation. */
  texts: () => ConfirmationTexts;
  /** Sends the command after the confirmation. */
  send: () => Promise<Outcome<unknown>>;
}

/** Used as the vehicle id of a `CommandToConfirm`, which may be for several vehicles. */
export const SEVERAL_VEHICLES = 'several';

export interface PendingConfirmation {
  action: ActionName;
  pagePart: PagePart;
  facts: VehicleFacts;
  target: GotoTarget | null;
  /** The stream's first setpoint; null: hold the vehicle's position. */
  streamStart: StreamStart | null;
  /** Null: the command and its texts are those of `action`. */
  command: CommandToConfirm | null;
  /** The texts when the confirmation was opened. */
  initialTexts: ConfirmationTexts;
  slider: ConfirmationSlider;
}

export interface RunningCommand {
  id: number;
  action: ActionName;
  /** The command's name, for the progress text. */
  commandName: string;
  pagePart: PagePart;
  vehicle: string;
  vehicleName: string;
  /** The server's latest progress text; null before the first text. */
  progressText: string | null;
  /** Progress 0–1, if the vehicle reports it. */
  fraction: number | null;
}

export interface Refusal {
  /** The command's name. */
  commandName: string;
  vehicleName: string;
  problem: Problem;
}

const DEFAULT_TAKEOFF_ALT_HOME_M = 10;
/** After a confirmation has closed without a key press, Space and Enter are ignored for this time [s]. */
const IGNORE_KEYS_S = 0.6;
/** Name of PX4's parameter for the return altitude [m above home]. */
const RETURN_ALT_PARAM = 'RTL_RETURN_ALT';
/** The API's limits of the take-off altitude [m above home]. */
export const TAKEOFF_RANGE_M = { min: 1, max: 120 } as const;

function notPossibleNow(detail: string): Problem {
  return { title: 'Not possible now', detail, reasons: [], remedy: null, code: 'refused', status: 0, field: null };
}

export class ActionController {
  confirmation = $state.raw<PendingConfirmation | null>(null);
  runningCommands = $state.raw<RunningCommand[]>([]);
  refusals = $state.raw<Partial<Record<PagePart, Refusal>>>({});
  takeoffAlt_home_m = $state(DEFAULT_TAKEOFF_ALT_HOME_M);
  /** Error of the typed altitude; null if it is valid. */
  takeoffProblem = $state<string | null>(null);
  /** Return altitudes that this page has read, by vehicle id. */
  private readonly returnAlts_home_m = new Map<string, number>();
  /** Progress of the confirmation, 0–1; updated once per animation frame. */
  sliderProgress = $state(0);
  /** Time until the confirmation expires; updated once per animation frame. */
  remaining_s = $state(0);
  private nextId = 1;
  /** Time at which the last confirmation closed without a key press [s]. */
  private closedWithoutKey_s = -Infinity;

  constructor(
    private readonly api: ApiClient,
    private readonly nowS: () => number,
    /** Starts the setpoint stream; the offboard feature provides this function. */
    private readonly startOffboard: (facts: VehicleFacts, streamStart: StreamStart | null) => Promise<Outcome<unknown>>,
    /** Reads the vehicle's present state; the vehicle may have moved since the confirmation was opened. */
    private readonly readFacts: (id: string) => VehicleFacts | null,
  ) {}

  /** The confirmation's texts with the vehicle's present altitude. */
  textsFor(confirmation: PendingConfirmation): ConfirmationTexts {
    const { action, facts, target, streamStart } = confirmation;
    return (
      confirmation.command?.texts() ?? confirmationTexts(action, this.actionFactsOf(this.currentFacts(facts)), target, streamStart) ?? confirmation.initialTexts
    );
  }

  /** Handles a button or key: opens the confirmation, sends an action without confirmation immediately, or shows why the action is not possible. */
  request(
    action: ActionName,
    facts: VehicleFacts | null,
    pagePart: PagePart = 'actionBar',
    target: GotoTarget | null = null,
    streamStart: StreamStart | null = null,
  ): void {
    if (facts === null || (action === 'goto' && target === null)) return;
    this.dismissRefusal(pagePart);
    const reason = reasonUnavailable(action, { ...this.actionFactsOf(facts), lost: facts.lost, replayed: facts.replayed });
    if (reason !== null) {
      this.confirmation = null;
      this.refusals = { ...this.refusals, [pagePart]: { commandName: ACTION_NAMES[action], vehicleName: facts.name, problem: notPossibleNow(reason) } };
      return;
    }
    const controlRefusal = controlProblem(action, this.actionFactsOf(facts).controlHolder ?? null);
    if (controlRefusal !== null) {
      this.confirmation = null;
      const problem: Problem = {
        ...notPossibleNow(controlRefusal.detail),
        title: 'Another client has control',
        code: 'not_in_control',
        remedy: controlRefusal.remedy,
      };
      this.refusals = { ...this.refusals, [pagePart]: { commandName: ACTION_NAMES[action], vehicleName: facts.name, problem } };
      return;
    }
    const texts = confirmationTexts(action, this.actionFactsOf(facts), target, streamStart);
    if (texts === null) {
      this.confirmation = null;
      void this.run(action, facts, pagePart);
      return;
    }
    this.confirmation = {
      action,
      pagePart,
      facts,
      target,
      streamStart,
      command: null,
      initialTexts: texts,
      slider: new ConfirmationSlider(texts.danger, this.nowS()),
    };
    this.sliderProgress = 0;
    this.remaining_s = this.confirmation.slider.remaining_s(this.nowS());
    this.takeoffProblem = null;
    if (action === 'rtl') void this.loadReturnAltitude(facts.id);
  }

  /** Opens the confirmation of a command. @param facts the selected vehicle. */
  requestCommand(command: CommandToConfirm, facts: VehicleFacts, pagePart: PagePart): void {
    this.dismissRefusal(pagePart);
    const texts = command.texts();
    const slider = new ConfirmationSlider(texts.danger, this.nowS());
    this.confirmation = { action: 'offboard_start', pagePart, facts, target: null, streamStart: null, command, initialTexts: texts, slider };
    this.sliderProgress = 0;
    this.remaining_s = slider.remaining_s(this.nowS());
  }

  /**
   * Sets the typed altitude. A value that is not a number or is outside the API's limits is reported and cannot be
   * confirmed.
   */
  enterTakeoffAltitude(alt_home_m: number): void {
    const { min, max } = TAKEOFF_RANGE_M;
    const isValid = Number.isFinite(alt_home_m) && alt_home_m >= min && alt_home_m <= max;
    this.takeoffProblem = isValid ? null : `Enter an altitude from ${min} to ${max} m above home.`;
    if (isValid) this.takeoffAlt_home_m = alt_home_m;
    if (this.confirmation === null) return;
    this.confirmation.slider.blocked = !isValid;
    this.confirmation.slider.restartExpiry(this.nowS());
  }

  /** Changes the take-off altitude by `by_m`, within the API's limits. */
  stepTakeoffAltitude(by_m: number): void {
    this.enterTakeoffAltitude(Math.min(TAKEOFF_RANGE_M.max, Math.max(TAKEOFF_RANGE_M.min, this.takeoffAlt_home_m + by_m)));
  }

  /** Handles the server's progress event of a running command; events of other clients' commands are ignored. */
  handleEvent(event: WireEvent): void {
    if (event.kind !== 'progress' || this.api.key === null || event['client_key'] !== this.api.key) return;
    const fraction = typeof event['fraction'] === 'number' ? event['fraction'] : null;
    this.runningCommands = this.runningCommands.map((r) =>
      r.vehicle === event.vehicle && r.action === event['command'] ? { ...r, progressText: event.text, fraction } : r,
    );
  }

  /** Closes the open confirmation without sending the command. */
  cancelConfirmation(): void {
    this.confirmation = null;
  }

  /** Whether a confirmation closed a moment ago because it expired or another vehicle was selected. */
  confirmationJustClosed(): boolean {
    return this.nowS() - this.closedWithoutKey_s < IGNORE_KEYS_S;
  }

  /** Hides the refusal in this part of the page. */
  dismissRefusal(pagePart: PagePart): void {
    this.refusals = { ...this.refusals, [pagePart]: undefined };
  }

  /** Once per animation frame: sends a confirmed command, and closes a confirmation that expired or whose vehicle is no longer selected. */
  onFrame(selectedId: string | null): void {
    const confirmation = this.confirmation;
    if (confirmation === null) return;
    const now = this.nowS();
    const phase = confirmation.command !== null || confirmation.facts.id === selectedId ? confirmation.slider.updatePhase(now) : 'cancelled';
    this.sliderProgress = confirmation.slider.progress();
    this.remaining_s = confirmation.slider.remaining_s(now);
    if (phase === 'asking') return;
    this.confirmation = null;
    if (phase !== 'confirmed') this.closedWithoutKey_s = now;
    if (phase === 'confirmed' && confirmation.command !== null) void this.runCommand(confirmation.command, confirmation.pagePart);
    else if (phase === 'confirmed')
      void this.run(confirmation.action, confirmation.facts, confirmation.pagePart, confirmation.target, confirmation.streamStart);
  }

  /** Shows a problem that was not caused by a button, as a refusal in `pagePart`. */
  showProblem(commandName: string, vehicleName: string, pagePart: PagePart, problem: Problem): void {
    this.refusals = { ...this.refusals, [pagePart]: { commandName, vehicleName, problem } };
  }

  /**
   * Sends a request without asking for confirmation, and shows a refusal in `pagePart`.
   * @returns whether the server accepted the request.
   */
  async attempt<T>(commandName: string, facts: Pick<VehicleFacts, 'name'>, pagePart: PagePart, sendRequest: () => Promise<Outcome<T>>): Promise<boolean> {
    const outcome = await sendRequest();
    const refusal = outcome.ok ? undefined : { commandName, vehicleName: facts.name, problem: outcome.problem };
    this.refusals = { ...this.refusals, [pagePart]: refusal };
    return outcome.ok;
  }

  private async run(
    action: ActionName,
    facts: VehicleFacts,
    pagePart: PagePart,
    target: GotoTarget | null = null,
    streamStart: StreamStart | null = null,
  ): Promise<void> {
    const runningCommand: RunningCommand = {
      id: this.nextId++,
      action,
      commandName: ACTION_NAMES[action],
      pagePart,
      vehicle: facts.id,
      vehicleName: facts.name,
      progressText: null,
      fraction: null,
    };
    this.runningCommands = [...this.runningCommands, runningCommand];
    const current = this.currentFacts(facts);
    const accepted = await this.attempt(runningCommand.commandName, current, pagePart, () => this.sendOrStartStream(action, current, target, streamStart));
    this.runningCommands = this.runningCommands.filter((r) => r.id !== runningCommand.id);
    target?.onResult?.(accepted);
  }

  private async runCommand({ commandName, vehicleNames, send }: CommandToConfirm, pagePart: PagePart): Promise<void> {
    const runningCommand: RunningCommand = {
      id: this.nextId++,
      action: 'offboard_start',
      commandName,
      pagePart,
      vehicle: SEVERAL_VEHICLES,
      vehicleName: vehicleNames,
      progressText: null,
      fraction: null,
    };
    this.runningCommands = [...this.runningCommands, runningCommand];
    await this.attempt(commandName, { name: vehicleNames }, pagePart, send);
    this.runningCommands = this.runningCommands.filter((r) => r.id !== runningCommand.id);
  }

  private sendOrStartStream(action: ActionName, facts: VehicleFacts, target: GotoTarget | null, streamStart: StreamStart | null): Promise<Outcome<unknown>> {
    if (action === 'offboard_start') return this.startOffboard(facts, streamStart);
    return sendAction(this.api, action, this.actionFactsOf(facts), target);
  }

  /** The vehicle's present state; if the vehicle was removed, the last known state. */
  private currentFacts(facts: VehicleFacts): VehicleFacts {
    return this.readFacts(facts.id) ?? facts;
  }

  /** The values for the confirmation texts. */
  private actionFactsOf(facts: VehicleFacts): ActionFacts {
    const controlHolder = otherControlHolder(facts.control, this.api.key);
    return { ...actionFacts(facts, this.takeoffAlt_home_m), controlHolder, returnAlt_home_m: this.returnAlts_home_m.get(facts.id) ?? null };
  }

  /** Reads the return altitude from the vehicle in the background; the open confirmation then shows it. */
  private async loadReturnAltitude(id: string): Promise<void> {
    const response = await this.api.get('/vehicles/{v}/params/{name}', { params: { path: { v: id, name: RETURN_ALT_PARAM } } });
    if (!response.ok || typeof response.value.value !== 'number') return;
    this.returnAlts_home_m.set(id, response.value.value);
    if (this.confirmation?.action === 'rtl') this.confirmation = { ...this.confirmation };
  }
}
