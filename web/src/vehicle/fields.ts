/**
 * Number fields of all forms: unit, step and scale by the suffix of a field's name (`speed_m_s`), bounds from the API, and typed
 * numbers. Pure functions.
 */

import { BOUNDS } from '../api/bounds';
import { DEG_PER_RAD } from '../ui/format';
import { boundIn, typedNumber as parseTyped, unitText } from '../ui/units';

export { typedNumber as parseTyped } from '../ui/units';

/** Smallest and largest number of a field. */
export interface Limits {
  readonly min?: number;
  readonly max?: number;
  /** The number must be larger than this. */
  readonly above?: number;
}

/** A field of a form as it is shown. */
export interface ShownField extends Limits {
  readonly label: string;
  readonly type: 'number' | 'choice' | 'switch' | 'text';
  readonly value: FieldValue;
  readonly unit?: string;
  /** The field may be empty; the form then shows this text in the field. */
  readonly placeholder?: string;
  readonly step?: number;
  readonly decimals?: number;
  readonly options?: readonly { readonly value: string; readonly text: string }[];
  readonly maxlength?: number;
}

export type FieldValue = number | string | boolean | null;

/** Suffixes of field names, each with unit or quantity (`ui/units.ts`) and step. The first match applies. */
const UNITS: readonly (readonly [suffix: string, unit: string, step: number])[] = [
  ['_m_s2', 'm/s²', 0.5],
  ['_m_s3', 'm/s³', 0.5],
  ['_deg_s', '°/s', 1],
  ['_rad_s', '°/s', 5],
  ['_m_s', 'speed', 0.5],
  ['_rad', '°', 5],
  ['_deg', '°', 1],
  ['_percent', '%', 1],
  ['_ms', 'ms', 10],
  ['_us', 'µs', 10],
  ['_mm', 'mm', 0.1],
  ['_px', 'px', 1],
  ['_hz', 'Hz', 1],
  ['_wh', 'Wh', 5],
  ['_kg', 'kg', 0.1],
  ['_w', 'W', 10],
  ['_m', 'length', 1],
  ['_s', 's', 1],
];
/** Largest angle that a form accepts, in both directions [°]. */
const FULL_TURN_DEG = 360;

/** Names of fields whose lengths and speeds are vertical. */
const VERTICAL = /(^|_)(alt|altitude|height|climb|sink|descent|base|lowest|top|value|up|look_at)_/;
const VERTICAL_QUANTITY: Readonly<Record<string, string>> = { length: 'height', speed: 'climb' };

/** How a quantity is shown. */
export interface Quantity extends Limits {
  readonly unit: string;
  readonly step: number;
  /** Shown value = value in the API × scale: angles are in degrees on the page. */
  readonly scale: number;
}

/** @param limits bounds in the API's unit. */
export function quantityOf(name: string, limits: Limits = {}): Quantity {
  const [suffix, found, step] = UNITS.find(([candidate]) => name.endsWith(candidate)) ?? ['', '', 1];
  const unit = (VERTICAL.test(name) ? VERTICAL_QUANTITY[found] : undefined) ?? found;
  const scale = suffix.startsWith('_rad') ? DEG_PER_RAD : 1;
  return { unit, step, scale, ...(scale === 1 ? limits : inDegrees(limits, suffix === '_rad')) };
}

/** Bounds in degrees, rounded to hundredths inwards. */
function inDegrees({ min, max, above }: Limits, isAngle: boolean): Limits {
  const limit = isAngle ? FULL_TURN_DEG : Infinity;
  const lowest = Math.max(-limit, min === undefined ? -Infinity : Math.ceil(min * DEG_PER_RAD * 100 - 1e-6) / 100);
  const highest = Math.min(limit, max === undefined ? Infinity : Math.floor(max * DEG_PER_RAD * 100 + 1e-6) / 100);
  return {
    ...(lowest === -Infinity || above !== undefined ? {} : { min: lowest }),
    ...(highest === Infinity ? {} : { max: highest }),
    ...(above === undefined ? {} : { above: above * DEG_PER_RAD }),
  };
}

/** The API's bounds of a field of a request; none if the API has none. @param model see `api/bounds.ts`. */
export function boundsOf(model: string, field: string): Limits {
  const models: Readonly<Record<string, Readonly<Record<string, Limits>>>> = BOUNDS;
  return models[model]?.[field] ?? {};
}

/** Bounds of a share, such as 0.95, in per cent. */
export function inPercent({ min, max, above }: Limits): Limits {
  const percent = (share: number | undefined): number | undefined => (share === undefined ? undefined : Number((share * 100).toFixed(6)));
  return limitsOf({ min: percent(min), max: percent(max), above: percent(above) });
}

/** Only the limits of a field; plain numbers may be passed on to `parseNumber`. */
export function limitsOf({ min, max, above }: { [L in keyof Limits]: Limits[L] | undefined }): Limits {
  return { ...(min === undefined ? {} : { min }), ...(max === undefined ? {} : { max }), ...(above === undefined ? {} : { above }) };
}

/** Why a number is outside its limits; null: it is inside. @param unit for the text, or a quantity: the text then has the limits in the chosen unit. */
export function limitProblem(value: number, { min, max, above }: Limits, unit = ''): string | null {
  const isInside = value >= (min ?? -Infinity) && value <= (max ?? Infinity) && value > (above ?? -Infinity);
  if (isInside) return null;
  const withUnit = unit === '' ? '' : ` ${unitText(unit)}`;
  const [least, most] = [min === undefined ? min : boundIn(unit, min, 'up'), max === undefined ? max : boundIn(unit, max, 'down')];
  if (above !== undefined) return `Enter a number above ${boundIn(unit, above, 'up')}${most === undefined ? '' : `, at most ${most}`}${withUnit}.`;
  if (least !== undefined && most !== undefined) return `Enter a number from ${least} to ${most}${withUnit}.`;
  return least === undefined ? `Enter a number of at most ${most}${withUnit}.` : `Enter a number of at least ${least}${withUnit}.`;
}

/** The API accepts no larger numbers. */
const [LARGEST, LEAST] = [{ max: 1e9 }, { min: -1e9 }] as const;

export type ParsedNumber = { ok: true; value: number | null } | { ok: false; problem: string };

/** Parses a typed number, in SI units. Empty text is null if the field is optional. @param unit for the text of a problem. */
export function parseNumber(text: string, limits: Limits & { optional?: boolean } = {}, unit = ''): ParsedNumber {
  if (text.trim() === '') return limits.optional === true ? { ok: true, value: null } : { ok: false, problem: 'Enter a number.' };
  const value = parseTyped(text);
  const problem =
    value === null ? `“${text.trim()}” is not a number.` : limitProblem(value, { ...LARGEST, ...(limits.above === undefined ? LEAST : {}), ...limits }, unit);
  return problem === null ? { ok: true, value } : { ok: false, problem };
}
