/**
 * The log of sent setpoints, newest first, with the server's result for each line. Setpoints that follow each
 * other quickly, from the gamepad or from a drag, share a line.
 */

import { unitText } from '../../../ui/units';
import { fixed, heightText, shown } from '../../../ui/format';
import { kindName } from '../../../vehicle/setpoint-kinds';

export type InputMethod = 'form' | 'drag' | 'gamepad' | 'group';

export interface SentLine {
  id: number;
  input: InputMethod;
  unix_s: number;
  /** Text of the newest setpoint of this line. */
  text: string;
  /** Number of setpoints in this line. */
  count: number;
  /** Number of setpoints in this line for which the server has sent a result. */
  resultCount: number;
  /** What the server changed, or why the server refused; null if it accepted all setpoints unchanged. */
  note: string | null;
  refused: boolean;
  /** Time from sending to the newest result [s]. */
  roundTrip_s: number | null;
}

const MAX_LINES = 60;
/** Setpoints of the same type and input share a line if the time between them is shorter [s]. */
const MERGE_S = 1;

export class SentLog {
  lines: readonly SentLine[] = [];
  private nextId = 1;
  private lastAdded_unix_s = 0;

  /** Adds a setpoint. @returns the id of its line, for `addResult`. */
  add(input: InputMethod, setpoint: Readonly<Record<string, unknown>>, unix_s: number): number {
    const [newest, ...rest] = this.lines;
    const text = setpointText(setpoint);
    const sharesLine =
      newest !== undefined &&
      input !== 'form' &&
      input !== 'group' &&
      newest.input === input &&
      unix_s - this.lastAdded_unix_s < MERGE_S &&
      !newest.refused &&
      newest.text.split(' ')[0] === text.split(' ')[0];
    this.lastAdded_unix_s = unix_s;
    if (sharesLine) {
      this.lines = [{ ...newest, text, count: newest.count + 1 }, ...rest];
      return newest.id;
    }
    const line: SentLine = { id: this.nextId++, input, unix_s, text, count: 1, resultCount: 0, note: null, refused: false, roundTrip_s: null };
    this.lines = [line, ...this.lines].slice(0, MAX_LINES);
    return line.id;
  }

  /** Adds the server's result to a line. */
  addResult(id: number, result: { note: string | null; refused: boolean; roundTrip_s: number | null }): void {
    this.lines = this.lines.map((l) =>
      l.id === id ? { ...l, ...result, resultCount: l.resultCount + 1, note: result.note ?? l.note, refused: result.refused || l.refused } : l,
    );
  }
}

const DEG_PER_RAD = 180 / Math.PI;

const NEU_WORDS = ['N', 'E', 'up'] as const;
const FRU_WORDS = ['forward', 'right', 'up'] as const;
const RATE_WORDS = ['roll', 'pitch', 'yaw'] as const;

/** Quantities (`ui/units.ts`) along the ground and of up. */
const VERTICAL: Readonly<Record<string, readonly [string, string]>> = { length: ['length', 'height'], speed: ['speed', 'climb'] };

/** Three values with the names of the axes. The third value of a given vector points down, and is shown up; rates are shown as they are. */
function vectorText(value: unknown, unit: string, words: readonly [string, string, string], note = ''): string | null {
  if (!Array.isArray(value)) return null;
  const [first, second, third] = words;
  const isUp = words !== RATE_WORDS;
  const [x, y, z] = value as (number | null)[];
  const text = (quantity: string, v: number | null | undefined): string => shown(quantity, v).text;
  const [ahead, up] = isUp ? (VERTICAL[unit] ?? [unit, unit]) : [unit, unit];
  const upUnit = unitText(up) === unitText(ahead) ? '' : ` ${unitText(up)}`;
  const [aheadUnit, endUnit] = upUnit === '' ? ['', ` ${unitText(ahead)}`] : [` ${unitText(ahead)}`, upUnit];
  return `${first} ${text(ahead, x)} ${second} ${text(ahead, y)}${aheadUnit} ${third} ${text(up, z == null ? z : isUp ? -z : z)}${endUnit}${note}`;
}

function numberText(value: unknown, format: (v: number) => string): string | null {
  return typeof value === 'number' ? format(value) : null;
}

/** A setpoint as a short line, in the form's units: altitudes and climb positive up, angles in degrees. */
export function setpointText(setpoint: Readonly<Record<string, unknown>>): string {
  const parts = [
    vectorText(setpoint['position_ned_m'], 'length', NEU_WORDS, ' from local origin'),
    vectorText(setpoint['offset_frd_m'], 'length', FRU_WORDS),
    numberText(setpoint['lat_deg'], (v) => v.toFixed(6)),
    numberText(setpoint['lon_deg'], (v) => v.toFixed(6)),
    numberText(setpoint['alt_home_m'], (v) => `${heightText(v)} above home`),
    numberText(setpoint['alt_amsl_m'], (v) => `${heightText(v)} AMSL`),
    vectorText(setpoint['velocity_ned_m_s'], 'speed', NEU_WORDS),
    vectorText(setpoint['velocity_frd_m_s'], 'speed', FRU_WORDS),
    vectorText(setpoint['acceleration_ned_m_s2'], 'm/s²', NEU_WORDS),
    numberText(setpoint['roll_rad'], (v) => `roll ${fixed(v * DEG_PER_RAD, 0)}°`),
    numberText(setpoint['pitch_rad'], (v) => `pitch ${fixed(v * DEG_PER_RAD, 0)}°`),
    Array.isArray(setpoint['rates_frd_rad_s'])
      ? vectorText(
          (setpoint['rates_frd_rad_s'] as number[]).map((v) => v * DEG_PER_RAD),
          '°/s',
          RATE_WORDS,
        )
      : null,
    typeof setpoint['vehicle'] === 'string' ? `from vehicle ${setpoint['vehicle']}` : null,
    numberText(setpoint['thrust'], (v) => `thrust ${fixed(v, 2)}`),
    numberText(setpoint['yaw_ned_rad'], (v) => `yaw ${fixed((((v * DEG_PER_RAD) % 360) + 360) % 360, 0)}°`),
    numberText(setpoint['yaw_offset_rad'], (v) => `turns by ${fixed(v * DEG_PER_RAD, 0, true)}°`),
    numberText(setpoint['yaw_rate_ned_rad_s'], (v) => `yaw ${fixed(v * DEG_PER_RAD, 0, true)}°/s`),
  ];
  return [kindName(typeof setpoint['type'] === 'string' ? setpoint['type'] : null), ...parts.filter((p) => p !== null)].join('  ');
}
