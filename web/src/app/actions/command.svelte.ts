/**
 * A command of the page is a value that is fixed when a person gives it: the vehicles by id, the names and the request. What
 * happens to the page afterwards, such as the selection of another vehicle, does not change the command.
 */

import type { Outcome } from '../../api/client';
import type { Problem } from '../../api/problems';
import type { ConfirmationTexts } from './actions';
import type { FuturesBody } from '../futures/futures';

export interface Command {
  /** The command's name, for progress texts and refusals. */
  readonly name: string;
  /** Ids of all vehicles that the command is for; empty: it is for no vehicle. */
  readonly vehicles: readonly string[];
  /** The part of the vehicle that the command is for, if the vehicle has several, such as gimbals. */
  readonly part?: string;
  /** Name of the vehicle, or names of several vehicles as one text. */
  readonly vehicleNames: string;
  /**
   * Sends the request, which was fixed when the command was given.
   * @param despite codes of findings that a person has accepted after the server refused the same request because of them.
   * @param fixed the vehicles as they were when the command was given: a command of several requests asks `problem()` before each.
   */
  readonly send: (despite: readonly string[], fixed: FixedVehicles) => Promise<Outcome<unknown>>;
  /** A person may accept the findings because of which the server refuses the command: `send` uses `despite`. */
  readonly acceptsFindings?: boolean;
  /** Why the command is no longer what a person gave, because the vehicle's state has changed; null: it is. */
  readonly changed?: () => string | null;
  /** Makes a vehicle stop what it is doing: can be sent again although an earlier request has no answer. */
  readonly stops?: boolean;
  /** One of a series, such as steps of a target: is sent although an earlier one has no answer yet. */
  readonly series?: boolean;
}

/** A command for one vehicle. */
export function commandTo(
  { id, name: vehicleNames }: { readonly id: string; readonly name: string },
  name: string,
  send: Command['send'],
  more: Partial<Command> = {},
): Command {
  return { name, vehicles: [id], vehicleNames, send, ...more };
}

/** A command that a person must confirm. */
export interface CommandToConfirm extends Command {
  /** Returns the present texts of the confirmation, for the vehicles of the command. */
  readonly texts: () => ConfirmationTexts;
  /** What the server flies in simulation while the confirmation is open, for the command's vehicle; missing: nothing. */
  readonly futures?: () => FuturesBody;
}

/** What identifies a command: the same command is not sent again before it has an answer. */
type CommandIdentity = Pick<Command, 'name' | 'vehicles' | 'part' | 'stops' | 'series'>;

/** Within this time after a command was given, giving the same command again is a double click [s]. */
const DOUBLE_CLICK_S = 0.7;
/** Code of a command that was not sent, because the same command was given a moment before: a double click. */
export const DOUBLE_CLICK = 'double_click';

function notSent(detail: string, remedy: string | null, code = 'refused'): Problem {
  return { title: 'Not sent', detail, reasons: [], remedy, code, status: 0, field: null };
}

/** What was true when a person gave a command that is sent later. */
export interface Given {
  readonly fixed: FixedVehicles;
  /** The vehicle that the page showed. */
  readonly selectedId: string | null;
}

/** The vehicles of a command, as they were when it was given. */
export class FixedVehicles {
  private readonly given: ReadonlyMap<string, unknown>;

  /** @param identify which vehicle has an id now: another value after the vehicle was replaced; null: no vehicle has the id. */
  constructor(
    readonly ids: readonly string[],
    private readonly identify: (id: string) => unknown,
  ) {
    this.given = new Map(ids.map((id) => [id, identify(id)]));
  }

  /** Why the command must not be sent any more: one of its vehicles was removed or replaced. Null: all are the same. */
  problem(): Problem | null {
    for (const [id, given] of this.given) {
      const now = this.identify(id);
      if (now === given) continue;
      const detail =
        now === null
          ? `Vehicle ${id} was removed while the command was waiting.`
          : `Another vehicle has taken the place of vehicle ${id} while the command was waiting.`;
      return notSent(detail, 'Check which vehicles are connected, then give the command again.', 'vehicle_changed');
    }
    return null;
  }
}

/** Sends each command once, and only to the vehicles for which it was given. */
export class CommandGate {
  /** When each command without an answer was given [s], by its key. */
  private waiting = $state.raw<ReadonlyMap<string, number>>(new Map());

  /** @param identify see `FixedVehicles`; the default knows no vehicles, so that none of them can change. */
  constructor(
    private readonly identify: (id: string) => unknown = () => undefined,
    private readonly nowS: () => number = () => performance.now() / 1000,
  ) {}

  /** Fixes the vehicles of a command: called when a person gives the command. */
  fix(vehicles: readonly string[]): FixedVehicles {
    return new FixedVehicles(vehicles, this.identify);
  }

  /** Whether the command was sent and has no answer yet. */
  isWaiting(command: CommandIdentity): boolean {
    return this.waiting.has(keyOf(command));
  }

  /** Why the command cannot be given now: the same command for the same vehicles has no answer yet. */
  waitingProblem(command: CommandIdentity): Problem | null {
    const given_s = this.waiting.get(keyOf(command));
    if (given_s === undefined || command.series === true) return null;
    const isDoubleClick = this.nowS() - given_s < DOUBLE_CLICK_S;
    if (command.stops === true && !isDoubleClick) return null;
    return notSent('The same command was sent before, and has no answer yet.', 'Wait for the answer.', isDoubleClick ? DOUBLE_CLICK : 'refused');
  }

  /**
   * Runs a command unless the same command for the same vehicles has no answer yet, or a vehicle has changed since `fixed`.
   * @param send gets the fixed vehicles: a command of several requests asks `problem()` again before each of them.
   */
  async run<T>(
    command: CommandIdentity,
    send: (fixed: FixedVehicles) => Promise<Outcome<T>>,
    fixed: FixedVehicles = this.fix(command.vehicles),
  ): Promise<Outcome<T>> {
    const problem = this.waitingProblem(command) ?? fixed.problem();
    if (problem !== null) return { ok: false, problem };
    const [key, given_s] = [keyOf(command), this.nowS()];
    this.waiting = new Map([...this.waiting, [key, given_s]]);
    try {
      return await send(fixed);
    } finally {
      if (this.waiting.get(key) === given_s) this.waiting = new Map([...this.waiting].filter(([other]) => other !== key));
    }
  }
}

/**
 * The command to give again after the server refused it because of findings: the same request, which names the codes of these
 * findings. Its confirmation lists them, after those that were accepted before. Null: it was not refused because of findings that
 * a person can accept.
 * @param stateNow state of the command's vehicles, which must not change: the findings are about this state.
 */
export function acceptanceOf(
  command: Command,
  texts: ConfirmationTexts,
  problem: Problem,
  stateBefore: string,
  stateNow: () => string,
): CommandToConfirm | null {
  const { codes = [], reasons, detail } = problem;
  if (command.acceptsFindings !== true || problem.code !== 'plan_findings' || codes.length === 0) return null;
  const findings = reasons.length > 0 ? reasons : [detail.replace(/ Nothing was sent\.$/, '')];
  const effect = `${texts.effect} You accept ${findings.length === 1 ? 'this finding' : 'these findings'}: ${findings.join(' ')}`;
  const changed = (): string | null =>
    stateNow() === stateBefore ? (command.changed?.() ?? null) : `The mode, the mission or the state of ${command.vehicleNames} has changed since the refusal.`;
  return {
    ...command,
    texts: () => ({ ...texts, effect, danger: true }),
    changed,
    send: (despite, fixed) => command.send([...codes, ...despite], fixed),
  };
}

function keyOf({ name, vehicles, part = '' }: CommandIdentity): string {
  return JSON.stringify([name, part, ...[...vehicles].sort()]);
}

/** Why an open confirmation must be closed; null: it may stay open. @param selectedId the vehicle that the page shows now. */
export function closingProblem({ vehicles, vehicleNames, changed }: CommandToConfirm, given: Given, selectedId: string | null): Problem | null {
  const isForOther = selectedId !== given.selectedId && (selectedId === null || !vehicles.includes(selectedId));
  const problem = given.fixed.problem();
  if (problem !== null) return problem;
  const change = changed?.() ?? null;
  if (isForOther)
    return notSent(`Another vehicle was selected before the command for ${vehicleNames} was confirmed.`, `Select ${vehicleNames} and give the command again.`);
  return change === null ? null : notSent(change, 'Give the command again.');
}
