/** The guarded links of programs. They are not part of the telemetry, so the page polls them. */

import type { ApiClient } from '../../api/client';
import type { components } from '../../api/schema';
import type { CommandToConfirm } from '../../app/actions/command.svelte';
import { ageText } from '../../live/age';
import { fixed, join } from '../../ui/format';
import type { VehicleFacts } from '../../vehicle/facts';

/** While there is a guarded link, and while there is none [ms]. */
const POLL_INTERVAL_MS = 1000;
const IDLE_INTERVAL_MS = 5000;
/** A program that sent its newest message longer ago is not there [s]. */
const PRESENT_S = 2;

export type Guard = components['schemas']['Guard'];
export type Program = components['schemas']['Program'];
export type Refused = components['schemas']['ProgramRefusal'];

export class Programs {
  list = $state.raw<readonly Guard[]>([]);

  poll(api: ApiClient): void {
    const request = async (): Promise<void> => {
      await this.read(api);
      setTimeout(() => void request(), this.list.length > 0 ? POLL_INTERVAL_MS : IDLE_INTERVAL_MS);
    };
    void request();
  }

  async read(api: ApiClient): Promise<void> {
    const answer = await api.get('/guards');
    this.list = answer.ok ? (answer.value.guards ?? []) : [];
  }

  /** The guarded links of a vehicle, and those that have none yet. */
  of(vehicle: string): readonly Guard[] {
    return this.list.filter((guard) => guard.vehicle === vehicle || guard.vehicle === null);
  }
}

/** The program that commands over a link, or else the one that was heard last; null: none was heard. */
export function shownProgram(guard: Guard): Program | null {
  const heard = guard.programs.filter((program) => program.age_s !== null);
  return heard.find((program) => program.commanding) ?? [...heard].sort((a, b) => (a.age_s ?? 0) - (b.age_s ?? 0))[0] ?? null;
}

const isPresent = (program: Program | null): boolean => program !== null && (program.age_s ?? Infinity) <= PRESENT_S;

/** The state of a guarded link in a word. */
export function stateText(guard: Guard): string {
  const program = shownProgram(guard);
  if (guard.paused !== null) return 'Overruled';
  if (guard.problem !== null) return 'Not connected';
  if (guard.flying) return 'Flies';
  if (program === null) return 'No program';
  if (!isPresent(program)) return 'Silent';
  return guard.control === 'read' ? 'Reads' : 'Connected';
}

/** What a program is and where. */
export function programText(program: Program): string {
  return join([program.kind ?? 'program', program.address, `${String(program.system)}/${String(program.component)}`]);
}

/** What a program sends; null: no setpoints. */
export function setpointText(program: Program): string | null {
  if (program.setpoint === null) return null;
  const kind = program.setpoint.replaceAll('_', ' ');
  const rate = program.setpoint_rate_hz;
  if (rate === null) return `Setpoint: ${kind}, none in the last 2 s`;
  return `Setpoint: ${kind} at ${fixed(rate, 0)} Hz`;
}

/** Setpoints that were not flown as the program sent them. */
export function countsText({ setpoints_late, setpoints_refused }: Program): string | null {
  const counts = [setpoints_late > 0 ? `${String(setpoints_late)} late` : null, setpoints_refused > 0 ? `${String(setpoints_refused)} refused` : null].filter(
    (text) => text !== null,
  );
  return counts.length === 0 ? null : `Setpoints: ${counts.join(', ')}`;
}

/** When something was refused, and how often. */
export function refusalText({ unix_s, repeated }: Refused, now_unix_s: number): string {
  const ago = `${ageText(Math.max(0, now_unix_s - unix_s))} ago`;
  return repeated > 1 ? `${ago}, ${String(repeated)} times` : ago;
}

/** Lets an overruled program command again. */
export function continueCommand(api: ApiClient, { id, name }: VehicleFacts, guard: Guard): CommandToConfirm {
  const texts = {
    title: 'Let the program continue',
    effect: `${guard.client} may command ${name} again. If it asks for Offboard, ${name} flies its setpoints at once.`,
    verb: 'Slide to let it continue',
    danger: false,
  };
  const send = () => api.post('/guards/{name}/resume', { params: { path: { name: guard.name } } });
  return { name: 'Let the program continue', vehicles: [id], vehicleNames: name, part: guard.name, texts: () => texts, send };
}
