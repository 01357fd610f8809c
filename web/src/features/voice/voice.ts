/** What the page says aloud of a vehicle: changes of mode, arming, connection, battery and distance. Pure. */

import { M_PER_FT, M_PER_NMI, distanceUnit } from '../../ui/units';
import type { VehicleFacts } from '../../vehicle/facts';

/** Charges that are said when the battery falls to them [%]. */
const CHARGES_PERCENT = [50, 30, 20, 15, 10, 5];
/** The distance from home is said at each multiple, on the way out: 100 m, 500 ft or a tenth of a nautical mile. */
function distanceStep(): { readonly m: number; readonly count: number; readonly words: string } {
  const unit = distanceUnit();
  if (unit === 'ft') return { m: 500 * M_PER_FT, count: 500, words: 'feet' };
  return unit === 'nmi' ? { m: M_PER_NMI / 10, count: 0.1, words: 'nautical miles' } : { m: 100, count: 100, words: 'metres' };
}
/** Least severe MAV_SEVERITY of messages that are said: warnings of the selected vehicle, errors of any. */
const SAID_OF_SELECTED = 4;
const SAID_OF_ANY = 3;

/** What is said; missing: all. */
export interface Said {
  readonly mode?: boolean | null;
  readonly battery?: boolean | null;
  readonly distance?: boolean | null;
}

/** The part of a vehicle's state whose changes are said. */
export interface Heard {
  readonly id: string;
  readonly lost: boolean;
  readonly armed: boolean | null;
  readonly mode: string | null;
  /** How many of `CHARGES_PERCENT` the battery has reached. */
  readonly charge: number;
  /** Farthest step from home on this flight. */
  readonly steps: number;
}

/** The state of a vehicle now; `before` keeps what only grows during a flight. */
export function heardOf(facts: VehicleFacts, before: Heard | null): Heard {
  const remaining = facts.battery?.value.remaining_percent ?? null;
  const steps = Math.floor((facts.homeDistance_m ?? 0) / distanceStep().m);
  const flies = before?.id === facts.id && before.armed === true && facts.inAir;
  return {
    id: facts.id,
    lost: facts.lost,
    armed: facts.status?.value.armed ?? null,
    mode: facts.status?.value.mode_label ?? null,
    charge: remaining === null ? (before?.charge ?? 0) : CHARGES_PERCENT.filter((percent) => remaining <= percent).length,
    steps: flies ? Math.max(steps, before.steps) : steps,
  };
}

/** Sentences about the changes; none for another vehicle, whose state is only taken over. */
export function sentences(before: Heard | null, now: Heard, wanted: Said = {}): string[] {
  if (before?.id !== now.id) return [];
  const charge = CHARGES_PERCENT[now.charge - 1];
  return [
    ...(wanted.mode === false ? [] : stateSentences(before, now)),
    ...(wanted.battery === false || now.charge <= before.charge || charge === undefined ? [] : [`Battery ${charge} percent`]),
    ...(wanted.distance === false || now.steps <= before.steps ? [] : [distanceSentence(now.steps)]),
  ];
}

function distanceSentence(steps: number): string {
  const { count, words } = distanceStep();
  return `${Number((steps * count).toFixed(1))} ${words} from home`;
}

function stateSentences(before: Heard, now: Heard): string[] {
  const said: string[] = [];
  if (now.lost !== before.lost) said.push(now.lost ? 'Connection lost' : 'Connected');
  if (now.armed !== before.armed && now.armed !== null && before.armed !== null) said.push(now.armed ? 'Armed' : 'Disarmed');
  if (now.mode !== before.mode && now.mode !== null) said.push(now.mode);
  return said;
}

/** Whether a message is severe enough to be said. */
export function isSevere(severity: unknown, isSelected: boolean): boolean {
  return typeof severity === 'number' && severity <= (isSelected ? SAID_OF_SELECTED : SAID_OF_ANY);
}
