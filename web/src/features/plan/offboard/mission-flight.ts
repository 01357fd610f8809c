/** An offboard mission in flight, as texts and numbers. Pure functions. */

import type { ConfirmationTexts } from '../../../app/actions/actions';
import { inSentence } from '../../../app/language';
import type { components } from '../../../api/schema';
import { durationText, lengthText } from '../../../ui/format';
import { isSameStart, positionAt, type GeoPosition } from '../../../vehicle/geo';
import { acceptedErrorsText } from '../flight/accepted-errors.svelte';
import type { DryRunResult } from '../dry-run/dry-run.svelte';
import type { Finding } from '../document/fixes';
import { nodesOf, type Mission } from './mission';

export type MissionFlight = components['schemas']['OffboardMissionStatus'];
type State = MissionFlight['state'];
/** `resume` ends a pause or an interruption; `go_on` answers the mission's question to the operator. */
export type FlightCommand = 'pause' | 'resume' | 'skip' | 'go_on' | 'abort';

const STATE_TEXTS: Readonly<Record<State, string>> = {
  ready: 'Starting',
  taking_off: 'Taking off',
  starting: 'Switching to Offboard',
  flying: 'Flying',
  not_following: 'Waiting: the vehicle does not follow',
  waiting: 'Waiting',
  pausing: 'Pausing',
  paused: 'Paused',
  landing: 'Landing',
  suspended: 'Interrupted by another mode',
  done: 'Done',
  aborted: 'Aborted',
  stopped: 'Ended early',
};
const END_STATES: readonly State[] = ['done', 'aborted', 'stopped'];

export function hasEnded(flight: MissionFlight): boolean {
  return END_STATES.includes(flight.state);
}

export function stateLabel(flight: MissionFlight): { text: string; tone: 'ok' | 'target' | 'caution' | 'dim' } {
  const text = flight.state === 'starting' && flight.mode !== 'offboard' ? 'Starting' : STATE_TEXTS[flight.state];
  if (flight.state === 'done') return { text, tone: 'ok' };
  if (hasEnded(flight) || flight.state === 'suspended' || flight.state === 'not_following') return { text, tone: 'caution' };
  return { text, tone: flight.state === 'paused' ? 'dim' : 'target' };
}

/** How the vehicle's last mission ended. */
export function lastFlightText(flight: MissionFlight, vehicleName: string): string {
  return `Last flight of “${flight.name}” by ${vehicleName}: ${inSentence(STATE_TEXTS[flight.state])}.`;
}

/** Text about who commands the vehicle during a mission; null: the flight mode has no executor, or the mission is over. */
export function executorText(flight: MissionFlight): string | null {
  if (hasEnded(flight) || flight.executor_in_charge === null) return null;
  return flight.executor_in_charge
    ? 'The mission commands the vehicle until another mode is selected.'
    : 'Another mode was selected, so the mission no longer commands the vehicle: PX4 accepts no command from it.';
}

/** The commands that are possible in the present state. */
export function availableCommands(flight: MissionFlight): readonly FlightCommand[] {
  if (hasEnded(flight)) return [];
  const isPaused = flight.state === 'paused' || flight.state === 'suspended' || flight.state === 'pausing';
  const goOnCommands: FlightCommand[] = flight.question === null || isPaused ? [] : ['go_on'];
  const skipCommands: FlightCommand[] = flight.others.length > 0 ? [] : ['skip']; // after a skipped step, vehicles that fly together would no longer be synchronized
  return [...goOnCommands, isPaused ? 'resume' : 'pause', ...skipCommands, 'abort'];
}

/** Texts of the command buttons. */
export const COMMAND_BUTTONS: Readonly<Record<FlightCommand, string>> = {
  pause: 'Pause',
  resume: 'Resume…',
  skip: 'Skip step…',
  go_on: 'Answer: continue',
  abort: 'Abort…',
};

/** Names of the commands in progress texts and refusals. */
export const COMMAND_NAMES: Readonly<Record<FlightCommand, string>> = {
  pause: 'Pause mission',
  resume: 'Resume mission',
  skip: 'Skip step',
  go_on: 'Continue mission',
  abort: 'Abort mission',
};

/** Elapsed part of the flight time, 0 to 1; null if it is not known. */
export function flightProgress(flight: MissionFlight): number | null {
  if (flight.remaining_s === null || !(flight.duration_s > 0)) return null;
  return Math.min(1, Math.max(0, 1 - flight.remaining_s / flight.duration_s));
}

/** The confirmation of a command; null: the command needs none. */
export function commandTexts(command: FlightCommand, flight: MissionFlight, vehicleName: string): ConfirmationTexts | null {
  const step = flight.title === null ? 'the current step' : `“${flight.title}”`;
  switch (command) {
    case 'pause':
    case 'go_on':
      return null;
    case 'resume':
      return {
        title: `Resume the mission of ${vehicleName}`,
        effect: `The vehicle flies straight back to its path and continues with ${step}. Check that there are no obstacles on the way.`,
        verb: 'Resume',
        danger: false,
      };
    case 'skip':
      return { title: `Skip ${step}`, effect: `${vehicleName} continues with the next step, straight from its current position.`, verb: 'Skip', danger: false };
    case 'abort':
      return {
        title: `Abort the mission of ${vehicleName}`,
        effect: 'The vehicle holds its position. The mission cannot be resumed.',
        verb: 'Abort',
        danger: false,
      };
  }
}

const ACTION_VERBS: Readonly<Record<string, string>> = { continue: 'continues', hold: 'holds', return: 'returns', land: 'lands' };

/**
 * Why this page cannot start a mission; null if it can.
 * @param blockingErrors errors that are not accepted; null: the mission has not been checked.
 */
export function startProblem(blockingErrors: readonly Finding[] | null, flight: MissionFlight | null): string | null {
  if (flight !== null && !hasEnded(flight)) return 'The vehicle is already flying a mission. Abort it first.';
  if (blockingErrors === null) return 'The mission has not been checked for this vehicle yet.';
  if (blockingErrors.length === 0) return null;
  return blockingErrorsText(blockingErrors);
}

/** Text about errors that are not accepted, with the text of the first error. */
export function blockingErrorsText(blockingErrors: readonly Finding[]): string {
  const text = blockingErrors[0]?.text ?? '';
  return blockingErrors.length === 1
    ? `An error to fix or accept below: ${text}`
    : `${blockingErrors.length} errors to fix or accept below. The first one: ${text}`;
}

/** The confirmation of the start: duration, warnings, failsafe actions. */
export function startTexts(
  mission: Mission,
  vehicleName: string,
  time_s: number | null,
  warningCount: number,
  streamStopText: string | null,
  acceptedTexts: readonly string[] = [],
): ConfirmationTexts {
  const { link_loss, low_battery, control_lost } = mission.actions;
  const actionText = (action: string): string => ACTION_VERBS[action] ?? action;
  const count = nodesOf(mission).filter((node) => node.depth === 0).length;
  const parts = [
    `${mission.steps?.[0]?.step === 'take_off' ? 'Arms, takes off and flies' : 'Flies'} ${count} ${count === 1 ? 'step' : 'steps'}${time_s === null ? '' : `, about ${durationText(time_s)}`}.`,
    warningCount === 0 ? '' : `The check found ${warningCount} ${warningCount === 1 ? 'warning' : 'warnings'}.`,
    acceptedErrorsText(acceptedTexts),
    `${low_battery === 'continue' ? 'Low battery: no action by the mission; the vehicle’s own setting applies' : `Low battery: the vehicle ${actionText(low_battery)}`}. If the controlling client is lost: the vehicle ${actionText(control_lost)}.`,
    `If the server fails or loses the connection to the vehicle: ${streamStopText ?? 'not known yet; the vehicle has not reported its parameters'}.`.replace(
      /\.\.$/,
      '.',
    ),
    `Once a lost connection is restored: the vehicle ${actionText(link_loss)}.`,
    'Hold interrupts the mission; you can resume it.',
  ];
  return {
    title: `Fly “${mission.name}” with ${vehicleName}`,
    effect: parts.filter((part) => part !== '').join(' '),
    verb: 'Fly',
    danger: acceptedTexts.length > 0,
  };
}

/**
 * Id of the dry run to compare a flight with: a dry run of this vehicle with a corridor, from the same start. Null: there
 * is none.
 * @param position position of the vehicle; null: not known.
 */
export function dryRunIdWithCorridor(result: DryRunResult | null, vehicle: string, position: GeoPosition | null): string | null {
  if (result?.monte_carlo?.corridor == null || result.vehicle !== vehicle || position === null) return null;
  return isSameStart(position, result.nominal.origin) ? result.id : null;
}

/** Like `dryRunIdWithCorridor`, for a mission with roles: all vehicles must match. @param positionOf null: the position is not known. */
export function dryRunIdWithCorridorForRoles(
  result: DryRunResult | null,
  vehicles: Readonly<Record<string, string>>,
  positionOf: (vehicle: string) => GeoPosition | null,
): string | null {
  const roles = Object.entries(result?.group?.monte_carlo?.roles ?? {});
  if (result === null || roles.length === 0) return null;
  const allMatch = roles.every(([role, { corridor }]) => {
    const vehicle = vehicles[role];
    const [north_m, east_m] = corridor?.position_ned_m[0] ?? [];
    const position = vehicle === undefined || vehicle !== result.vehicles?.[role] ? null : positionOf(vehicle);
    if (position === null || north_m === undefined || east_m === undefined) return false;
    return isSameStart(position, positionAt(result.nominal.origin, { north_m, east_m }));
  });
  return allMatch ? result.id : null;
}

/** Text about the distance outside the corridor; null if the vehicle is inside or no corridor is monitored. */
export function corridorText({ outside_corridor_m }: Pick<MissionFlight, 'outside_corridor_m'>): string | null {
  const outside_m = outside_corridor_m ?? 0;
  return outside_m > 0 ? `${lengthText(outside_m)} outside the corridor of the dry run` : null;
}

/** Text about the distance from the setpoint; null if it is not known. */
export function deviationText(flight: MissionFlight): string | null {
  return flight.deviation_m === null ? null : `${lengthText(flight.deviation_m)} position error`;
}
