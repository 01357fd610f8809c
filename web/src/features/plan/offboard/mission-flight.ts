/** An offboard mission in flight, as texts and numbers. Pure. */

import type { Question } from '../../../app/actions/actions';
import type { components } from '../../../api/schema';
import { duration, fixed } from '../../../ui/format';
import { isSameStart, positionAt, type GeoPosition } from '../../../vehicle/geo';
import { acceptedErrorsText } from '../flight/accepted-errors.svelte';
import type { DryRunView } from '../dry-run/dry-run.svelte';
import type { Finding } from '../document/fixes';
import { nodesOf, type Mission } from './mission';

export type Flown = components['schemas']['OffboardMissionStatus'];
type State = Flown['state'];
export type FlightCommand = 'pause' | 'resume' | 'skip' | 'go_on' | 'abort';

const WORDS: Readonly<Record<State, string>> = {
  ready: 'Starting',
  taking_off: 'Taking off',
  starting: 'Switching to Offboard',
  flying: 'Flying',
  waiting: 'Waiting',
  pausing: 'Pausing',
  paused: 'Paused',
  landing: 'Landing',
  suspended: 'Interrupted by another mode',
  done: 'Done',
  aborted: 'Aborted',
  stopped: 'Stopped',
};
const FINISHED_STATES: readonly State[] = ['done', 'aborted', 'stopped'];

export function isOver(flown: Flown): boolean {
  return FINISHED_STATES.includes(flown.state);
}

export function stateLabel(flown: Flown): { text: string; tone: 'ok' | 'target' | 'caution' | 'dim' } {
  const text = flown.state === 'starting' && flown.mode !== 'offboard' ? 'Starting' : WORDS[flown.state];
  if (flown.state === 'done') return { text, tone: 'ok' };
  if (isOver(flown) || flown.state === 'suspended') return { text, tone: 'caution' };
  return { text, tone: flown.state === 'paused' ? 'dim' : 'target' };
}

/** How the vehicle's last mission ended. */
export function lastFlightText(flown: Flown, vehicleName: string): string {
  return `Last flight of “${flown.name}” by ${vehicleName}: ${WORDS[flown.state].toLowerCase()}.`;
}

/** Who commands the vehicle during a mission whose flight mode has an executor; null: its mode has none, or it is over. */
export function executorText(flown: Flown): string | null {
  if (isOver(flown) || flown.executor_in_charge === null) return null;
  return flown.executor_in_charge
    ? 'The mission commands the vehicle until another mode is selected.'
    : 'Another mode was selected, so the mission no longer commands the vehicle: PX4 accepts no command from it.';
}

/** The commands that are possible in the present state. */
export function availableCommands(flown: Flown): readonly FlightCommand[] {
  if (isOver(flown)) return [];
  const isPaused = flown.state === 'paused' || flown.state === 'suspended' || flown.state === 'pausing';
  const answer: FlightCommand[] = flown.question === null || isPaused ? [] : ['go_on'];
  const skip: FlightCommand[] = flown.others.length > 0 ? [] : ['skip']; // vehicles that fly together would lose their common timing
  return [...answer, isPaused ? 'resume' : 'pause', ...skip, 'abort'];
}

export const COMMAND_NAMES: Readonly<Record<FlightCommand, string>> = {
  pause: 'Pause',
  resume: 'Resume…',
  skip: 'Skip step…',
  go_on: 'Continue',
  abort: 'Abort…',
};

/** The commands in progress texts and refusals. */
export const COMMAND_TEXTS: Readonly<Record<FlightCommand, string>> = {
  pause: 'Pause mission',
  resume: 'Resume mission',
  skip: 'Skip step',
  go_on: 'Continue mission',
  abort: 'Abort mission',
};

/** Elapsed part of the flight time, 0 to 1; null if it is not known. */
export function progress(flown: Flown): number | null {
  if (flown.remaining_s === null || !(flown.duration_s > 0)) return null;
  return Math.min(1, Math.max(0, 1 - flown.remaining_s / flown.duration_s));
}

/** The confirmation of a command that moves the vehicle; null: it is sent at once. */
export function commandQuestion(command: FlightCommand, flown: Flown, vehicleName: string): Question | null {
  const step = flown.title === null ? 'the current step' : `“${flown.title}”`;
  switch (command) {
    case 'pause':
    case 'go_on':
      return null;
    case 'resume':
      return {
        title: `Resume the mission of ${vehicleName}`,
        effect: `Flies straight back to its path and continues with ${step}. Check that there are no obstacles on the way.`,
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

const ACTIONS: Readonly<Record<string, string>> = { continue: 'continues', hold: 'holds', return: 'returns', land: 'lands' };

/**
 * Why this page cannot start a mission; null if it can.
 * @param open errors that are not accepted; null: the mission has not been checked.
 */
export function startProblem(open: readonly Finding[] | null, flown: Flown | null): string | null {
  if (flown !== null && !isOver(flown)) return 'The vehicle is already flying a mission. Abort it first.';
  if (open === null) return 'The mission has not been checked for this vehicle yet.';
  if (open.length === 0) return null;
  return `${open.length === 1 ? 'An error' : `${open.length} errors`} to fix or accept below: ${open[0]?.text ?? ''}`;
}

/** The confirmation of the start: duration, warnings, failsafe actions. */
export function startQuestion(
  mission: Mission,
  vehicleName: string,
  time_s: number | null,
  warnings: number,
  ifStreamStops: string | null,
  despite: readonly string[] = [],
): Question {
  const { link_loss, low_battery, control_lost } = mission.actions;
  const does = (action: string): string => ACTIONS[action] ?? action;
  const parts = [
    `${nodesOf(mission).filter((node) => node.depth === 0).length} steps${time_s === null ? '' : `, about ${duration(time_s)}`}${warnings === 0 ? '' : `, ${warnings} ${warnings === 1 ? 'warning' : 'warnings'}`}.`,
    acceptedErrorsText(despite),
    `Low battery: the vehicle ${does(low_battery)}. If the controlling client is lost: it ${does(control_lost)}. After a lost link is restored: it ${does(link_loss)}.`,
    `If the server or its link fails: ${ifStreamStops ?? 'not known yet; the vehicle has not reported its parameters'}.`.replace(/\.\.$/, '.'),
    'Hold stops the mission at any time.',
  ];
  return { title: `Fly “${mission.name}” with ${vehicleName}`, effect: parts.filter((part) => part !== '').join(' '), verb: 'Fly', danger: despite.length > 0 };
}

/**
 * The dry run to compare a flight with: one with a corridor, of this vehicle, with the same start. Null if there is
 * none.
 */
export function corridorFor(view: DryRunView | null, vehicle: string, here: GeoPosition | null): string | null {
  if (view?.monte_carlo?.corridor == null || view.vehicle !== vehicle || here === null) return null;
  return isSameStart(here, view.nominal.origin) ? view.id : null;
}

/** The same for the vehicles of a mission with roles. @param here the position of a vehicle; null: it is not known. */
export function corridorForRoles(
  view: DryRunView | null,
  vehicles: Readonly<Record<string, string>>,
  here: (vehicle: string) => GeoPosition | null,
): string | null {
  const roles = Object.entries(view?.together?.monte_carlo?.roles ?? {});
  if (view === null || roles.length === 0) return null;
  const fits = roles.every(([role, { corridor }]) => {
    const vehicle = vehicles[role];
    const [north_m, east_m] = corridor?.position_ned_m[0] ?? [];
    const at = vehicle === undefined || vehicle !== view.vehicles?.[role] ? null : here(vehicle);
    if (at === null || north_m === undefined || east_m === undefined) return false;
    return isSameStart(at, positionAt(view.nominal.origin, { north_m, east_m }));
  });
  return fits ? view.id : null;
}

/** Text about the distance outside the corridor; null if the vehicle is inside or no corridor is monitored. */
export function corridorText({ outside_corridor_m }: Pick<Flown, 'outside_corridor_m'>): string | null {
  const out_m = outside_corridor_m ?? 0;
  return out_m > 0 ? `${fixed(out_m, 1)} m outside the corridor of the dry run` : null;
}

/** Text about the distance from the setpoint; null if it is not known. */
export function deviationText(flown: Flown): string | null {
  return flown.deviation_m === null ? null : `${fixed(flown.deviation_m, 1)} m position error`;
}
