/** Asks for confirmation, sends commands, and shows a refusal beside the button that was pressed. */

import { boundIn, unitText } from '../../ui/units';
import type { VehicleFacts } from '../../vehicle/facts';
import { BOUNDS } from '../../api/bounds';
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
import { toRequestSetpoint, type StreamStart } from '../../vehicle/setpoint';
import type { FuturesBody } from '../futures/futures';
import { userSettings } from '../settings.svelte';
import { acceptanceOf, closingProblem, CommandGate, DOUBLE_CLICK, type Command, type CommandToConfirm, type FixedVehicles, type Given } from './command.svelte';
import { ConfirmationSlider } from './confirmation';

/** The part of the page that contains the pressed button and shows the refusal; a feature chooses the names of its parts. */
export type PagePart = string;
/** The part that shows the refusals of shortcuts, and of commands whose own part is not shown. */
export const MAIN_PART: PagePart = 'actionBar';

export interface PendingConfirmation {
  /** The vehicle action that the command is; null: another command. */
  action: ActionName | null;
  pagePart: PagePart;
  command: CommandToConfirm;
  given: Given;
  slider: ConfirmationSlider;
}

export interface RunningCommand {
  id: number;
  /** The vehicle action that the command is; null: another command. */
  action: ActionName | null;
  /** The command's name, for the progress text. */
  commandName: string;
  pagePart: PagePart;
  /** The vehicle's id; null: a command for several vehicles. */
  vehicle: string | null;
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
  /** The command that accepts the findings because of which the server refused; null: there are none, or they cannot be accepted. */
  acceptance?: Pick<PendingConfirmation, 'action' | 'command' | 'given'> | null;
}

const DEFAULT_TAKEOFF_ALT_HOME_M = 10;
/** After a confirmation has closed without a key press, Space and Enter are ignored for this time [s]. */
const IGNORE_KEYS_S = 0.6;
/** Name of PX4's parameter for the return altitude [m above home]. */
const RETURN_ALT_PARAM = 'RTL_RETURN_ALT';
/** Futures reach at least so far [s], and so many times the expected time of a flight. */
const MIN_HORIZON_S = 20;
const FLIGHT_TIME_MARGIN = 1.4;
/** Actions that end what the vehicle is doing: a pilot can always give them again. */
const STOPS: ReadonlySet<ActionName> = new Set(['hold', 'land', 'land_now', 'rtl', 'kill']);
/** The API's limits of the take-off altitude [m above home]. */
export const TAKEOFF_RANGE_M = BOUNDS.TakeoffRequest.alt_home_m;

function notPossibleNow(detail: string): Problem {
  return { title: 'Not possible now', detail, reasons: [], remedy: null, code: 'refused', status: 0, field: null };
}

/** What the server flies in simulation before a go-to or the start of a stream in the air; null: nothing. */
function futuresOf(action: ActionName, { inAir }: VehicleFacts, target: GotoTarget | null, streamStart: StreamStart | null): (() => FuturesBody) | null {
  if (action === 'goto' && target !== null) {
    const { lat_deg, lon_deg, alt_home_m, time_s } = target;
    const horizon_s = Math.min(BOUNDS.FuturesRequest.horizon_s.max, Math.max(MIN_HORIZON_S, Math.ceil(FLIGHT_TIME_MARGIN * (time_s ?? 0))));
    return () => ({ goto: { lat_deg, lon_deg, alt_home_m }, horizon_s });
  }
  if (action !== 'offboard_start' || streamStart === null || !inAir) return null;
  return () => ({ setpoint: toRequestSetpoint(streamStart.newest?.() ?? streamStart.setpoint) });
}

export class ActionController {
  confirmation = $state.raw<PendingConfirmation | null>(null);
  runningCommands = $state.raw<RunningCommand[]>([]);
  refusals = $state.raw<Partial<Record<PagePart, Refusal>>>({});
  /** The take-off altitude that a person has typed; null: none yet. */
  private typedAlt_home_m = $state<number | null>(null);
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

  /** Altitude above home of the next take-off. */
  get takeoffAlt_home_m(): number {
    return this.typedAlt_home_m ?? userSettings.get('default_altitudes')?.takeoff_m ?? DEFAULT_TAKEOFF_ALT_HOME_M;
  }

  constructor(
    private readonly api: ApiClient,
    private readonly nowS: () => number,
    /** Starts the setpoint stream; the offboard feature provides this function. */
    private readonly startOffboard: (facts: VehicleFacts, streamStart: StreamStart | null) => Promise<Outcome<unknown>>,
    /** Reads the vehicle's present state; the vehicle may have moved since the confirmation was opened. */
    private readonly readFacts: (id: string) => VehicleFacts | null,
    readonly gate = new CommandGate(),
    /** The vehicle that the page shows. */
    private readonly selectedId: () => string | null = () => null,
    /** State of a vehicle that the server's findings are about, as a text. */
    private readonly stateOf: (id: string) => string = () => '',
  ) {}

  /** The confirmation's present texts. */
  textsFor(confirmation: PendingConfirmation): ConfirmationTexts {
    return confirmation.command.texts();
  }

  /** Handles a button or key: opens the confirmation, sends an action without confirmation immediately, or shows why the action is not possible. */
  request(
    action: ActionName,
    facts: VehicleFacts | null,
    pagePart: PagePart = MAIN_PART,
    target: GotoTarget | null = null,
    streamStart: StreamStart | null = null,
  ): void {
    if (facts === null || (action === 'goto' && target === null)) return;
    this.dismissRefusal(pagePart);
    const problem = this.unavailableProblem(action, facts);
    if (problem !== null) {
      this.confirmation = null;
      this.showProblem(ACTION_NAMES[action], facts.name, pagePart, problem);
      return;
    }
    const initialTexts = confirmationTexts(action, this.actionFactsOf(facts), target, streamStart);
    const command: Command = {
      name: ACTION_NAMES[action],
      vehicles: [facts.id],
      vehicleNames: facts.name,
      stops: STOPS.has(action),
      acceptsFindings: action === 'arm' || action === 'goto',
      send: async (despite) => {
        const outcome = await this.sendOrStartStream(action, this.currentFacts(facts), target, streamStart, despite);
        target?.onResult?.(outcome.ok);
        return outcome;
      },
    };
    if (initialTexts === null) {
      this.confirmation = null;
      void this.run(action, command, pagePart, this.give(command.vehicles));
      return;
    }
    const texts = (): ConfirmationTexts => confirmationTexts(action, this.actionFactsOf(this.currentFacts(facts)), target, streamStart) ?? initialTexts;
    const futures = futuresOf(action, facts, target, streamStart);
    this.ask(action, futures === null ? { ...command, texts } : { ...command, texts, futures }, pagePart);
    if (action === 'rtl') void this.loadReturnAltitude(facts.id);
  }

  /** What is true now, for a command that a person gives now and that is sent or confirmed later. */
  give(vehicles: readonly string[]): Given {
    return { fixed: this.gate.fix(vehicles), selectedId: this.selectedId() };
  }

  /** Opens the confirmation of a command. @param given when the person gave the command; before the page saved a plan, for example. */
  requestCommand(command: CommandToConfirm, pagePart: PagePart, given = this.give(command.vehicles), action: ActionName | null = null): void {
    this.dismissRefusal(pagePart);
    const problem = closingProblem(command, given, this.selectedId());
    if (problem === null) this.ask(action, command, pagePart, given);
    else this.showProblem(command.name, command.vehicleNames, pagePart, problem);
  }

  /** Asks for confirmation of the command that the server refused, with the findings that it named; nothing is sent before. */
  acceptFindings(pagePart: PagePart): void {
    const acceptance = this.refusals[pagePart]?.acceptance ?? null;
    if (acceptance !== null) this.requestCommand(acceptance.command, pagePart, acceptance.given, acceptance.action);
  }

  /** Opens a confirmation; instead of it shows that the same command has no answer yet. */
  private ask(action: ActionName | null, command: CommandToConfirm, pagePart: PagePart, given = this.give(command.vehicles)): void {
    this.confirmation = null;
    const problem = this.gate.waitingProblem(command);
    if (problem !== null) return this.showProblem(command.name, command.vehicleNames, pagePart, problem);
    const slider = new ConfirmationSlider(command.texts().danger, this.nowS());
    this.confirmation = { action, pagePart, command, given, slider };
    this.sliderProgress = 0;
    this.remaining_s = slider.remaining_s(this.nowS());
    this.takeoffProblem = null;
  }

  /** Why an action is not possible now; null: it is possible. */
  private unavailableProblem(action: ActionName, facts: VehicleFacts): Problem | null {
    const reason = reasonUnavailable(action, { ...this.actionFactsOf(facts), lost: facts.lost, replayed: facts.replayed });
    if (reason !== null) return notPossibleNow(reason);
    const refusal = controlProblem(action, this.actionFactsOf(facts).controlHolder ?? null);
    if (refusal === null) return null;
    return { ...notPossibleNow(refusal.detail), title: 'Another client has control', code: 'not_in_control', remedy: refusal.remedy };
  }

  /**
   * Sets the typed altitude. A value that is not a number or is outside the API's limits is reported and cannot be
   * confirmed.
   */
  enterTakeoffAltitude(alt_home_m: number): void {
    const { min, max } = TAKEOFF_RANGE_M;
    const isValid = Number.isFinite(alt_home_m) && alt_home_m >= min && alt_home_m <= max;
    this.takeoffProblem = isValid
      ? null
      : `Enter an altitude from ${boundIn('height', min, 'up')} to ${boundIn('height', max, 'down')} ${unitText('height')} above home.`;
    if (isValid) this.typedAlt_home_m = alt_home_m;
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

  /**
   * Once per animation frame: sends a confirmed command, and closes a confirmation that expired. Closes it with a word if one of
   * its vehicles was removed or replaced, or if a vehicle was selected that the command is not for.
   */
  onFrame(selectedId: string | null): void {
    const confirmation = this.confirmation;
    if (confirmation === null) return;
    const now = this.nowS();
    const { action, command, given, pagePart, slider } = confirmation;
    const problem = closingProblem(command, given, selectedId);
    const phase = problem === null ? slider.updatePhase(now) : 'cancelled';
    this.sliderProgress = slider.progress();
    this.remaining_s = slider.remaining_s(now);
    if (phase === 'asking') return;
    this.confirmation = null;
    if (phase !== 'confirmed') this.closedWithoutKey_s = now;
    if (problem !== null) this.showProblem(command.name, command.vehicleNames, MAIN_PART, problem);
    if (phase === 'confirmed') void this.run(action, command, pagePart, given, command.texts());
  }

  /** Shows a problem that was not caused by a button, as a refusal in `pagePart`. */
  showProblem(commandName: string, vehicleName: string, pagePart: PagePart, problem: Problem, acceptance: Refusal['acceptance'] = null): void {
    this.refusals = { ...this.refusals, [pagePart]: { commandName, vehicleName, problem, acceptance } };
  }

  /**
   * Sends a command without asking for confirmation, and shows a refusal in `pagePart`. A command that has no answer yet is not
   * sent a second time.
   * @returns whether the server accepted the command.
   */
  async attempt(command: Command, pagePart: PagePart, given?: FixedVehicles): Promise<boolean> {
    const outcome = await this.gate.run(command, (fixed) => command.send([], fixed), given);
    return this.show(outcome, command.name, command.vehicleNames, pagePart);
  }

  /** Shows the outcome of a command in `pagePart`. @returns whether the server accepted the command. */
  private show(outcome: Outcome<unknown>, commandName: string, vehicleName: string, pagePart: PagePart, acceptance: Refusal['acceptance'] = null): boolean {
    // The refusal of a command to another vehicle stays.
    if (outcome.ok && this.refusals[pagePart]?.vehicleName === vehicleName) this.dismissRefusal(pagePart);
    if (outcome.ok) return true;
    if (outcome.problem.code !== DOUBLE_CLICK) this.showProblem(commandName, vehicleName, pagePart, outcome.problem, acceptance);
    return false;
  }

  /** @param texts the texts that a person confirmed; null: the command needs no confirmation. */
  private async run(action: ActionName | null, command: Command, pagePart: PagePart, given: Given, texts: ConfirmationTexts | null = null): Promise<void> {
    const stateNow = (): string => JSON.stringify(command.vehicles.map((id) => this.stateOf(id)));
    const stateBefore = stateNow();
    const send = async (fixed: FixedVehicles): Promise<Outcome<unknown>> => {
      const { name: commandName, vehicles, vehicleNames: vehicleName } = command;
      const vehicle = vehicles.length === 1 ? (vehicles[0] ?? null) : null;
      const id = this.nextId++;
      this.runningCommands = [...this.runningCommands, { id, action, commandName, pagePart, vehicle, vehicleName, progressText: null, fraction: null }];
      try {
        return await command.send([], fixed);
      } finally {
        this.runningCommands = this.runningCommands.filter((r) => r.id !== id);
      }
    };
    const outcome = await this.gate.run(command, send, given.fixed);
    const acceptable = outcome.ok || texts === null ? null : acceptanceOf(command, texts, outcome.problem, stateBefore, stateNow);
    this.show(outcome, command.name, command.vehicleNames, pagePart, acceptable === null ? null : { action, command: acceptable, given });
  }

  private sendOrStartStream(
    action: ActionName,
    facts: VehicleFacts,
    target: GotoTarget | null,
    streamStart: StreamStart | null,
    despite: readonly string[],
  ): Promise<Outcome<unknown>> {
    if (action === 'offboard_start') return this.startOffboard(facts, streamStart);
    return sendAction(this.api, action, this.actionFactsOf(facts), target, despite);
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
