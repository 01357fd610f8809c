/**
 * The units that a person has chosen. All values are in SI units in the state and in the API; only what is shown and what is
 * typed is converted, here. A unit of a field is either a plain text (“°”, “s”) or a quantity of this file.
 */

export type Quantity = 'height' | 'length' | 'speed' | 'climb';

/** Null or missing: the SI unit. */
export interface UnitChoice {
  readonly height?: 'm' | 'ft' | null;
  readonly distance?: 'm' | 'ft' | 'nmi' | null;
  readonly speed?: 'm/s' | 'km/h' | 'mph' | 'kn' | null;
  readonly vertical_speed?: 'm/s' | 'ft/min' | null;
}

interface Unit {
  readonly text: string;
  /** Shown value = SI value × factor. */
  readonly factor: number;
  /** Decimals that have no meaning in this unit are left out: 100 ft/min, not 98.4. */
  readonly decimals?: number;
}

export const M_PER_FT = 0.3048;
export const M_PER_MI = 1609.344;
export const M_PER_NMI = 1852;
const METRE: Unit = { text: 'm', factor: 1 };
const M_S: Unit = { text: 'm/s', factor: 1 };
const UNITS: Readonly<Record<string, Unit>> = {
  m: METRE,
  ft: { text: 'ft', factor: 1 / M_PER_FT },
  'm/s': M_S,
  'km/h': { text: 'km/h', factor: 3.6 },
  mph: { text: 'mph', factor: 3600 / M_PER_MI },
  kn: { text: 'kn', factor: 3600 / M_PER_NMI },
  'ft/min': { text: 'ft/min', factor: 60 / M_PER_FT, decimals: 0 },
};
/** Decimals of a typed value as it is shown. */
const TYPED_DECIMALS = 2;

let readChoice: () => UnitChoice | null = () => null;

/** Sets where the chosen units are read, each time that a value is shown. */
export function provideUnits(read: () => UnitChoice | null): void {
  readChoice = read;
}

/** The unit of distances over ground; short ones are in m or ft. */
export function distanceUnit(): 'm' | 'ft' | 'nmi' {
  return readChoice()?.distance ?? 'm';
}

/** The chosen unit of a quantity; null: it is a plain text. */
function unitOf(unit: string): Unit | null {
  const choice = readChoice();
  switch (unit) {
    case 'height':
      return UNITS[choice?.height ?? 'm'] ?? METRE;
    case 'length':
      return UNITS[(choice?.distance === 'nmi' ? choice.height : choice?.distance) ?? 'm'] ?? METRE;
    case 'speed':
      return UNITS[choice?.speed ?? 'm/s'] ?? M_S;
    case 'climb':
      return UNITS[choice?.vertical_speed ?? 'm/s'] ?? M_S;
    default:
      return null;
  }
}

/** The text of a unit: that of a quantity as chosen, or else the text itself. */
export const unitText = (unit: string): string => unitOf(unit)?.text ?? unit;

/** A value as it is shown. */
export function inUnit(unit: string, value: number): number {
  const { factor } = unitOf(unit) ?? METRE;
  return value * factor;
}

/** A shown value in SI units. */
export function fromUnit(unit: string, shown: number): number {
  const { factor } = unitOf(unit) ?? METRE;
  return factor === 1 ? shown : Number((shown / factor).toPrecision(12));
}

/** Decimals of a value that has `decimals` in SI units. */
export const decimalsIn = (unit: string, decimals: number): number => unitOf(unit)?.decimals ?? decimals;

/** A bound of a quantity as it is shown, rounded inwards so that the server accepts it when it is typed. */
export function boundIn(unit: string, bound: number, inwards: 'up' | 'down'): number {
  const { factor } = unitOf(unit) ?? METRE;
  if (factor === 1) return bound;
  const hundreds = inUnit(unit, bound) * 100;
  return (inwards === 'up' ? Math.ceil(hundreds - 1e-6) : Math.floor(hundreds + 1e-6)) / 100;
}

/** A step of a field in its shown unit: 1, 2 or 5 times a power of ten, near the step in SI units. */
export function stepIn(unit: string, step: number): number {
  const factor = unitOf(unit)?.factor ?? 1;
  if (factor === 1) return step;
  const power = 10 ** Math.floor(Math.log10(step * factor));
  const mantissa = (step * factor) / power;
  return Number(((mantissa < 1.5 ? 1 : mantissa < 3.5 ? 2 : mantissa < 7.5 ? 5 : 10) * power).toPrecision(6));
}

/** A typed number; null: it is none. */
export function typedNumber(text: string): number | null {
  const normalized = text.trim().replace('−', '-').replace(',', '.');
  if (!/^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(normalized)) return null;
  const value = Number(normalized);
  return Number.isFinite(value) ? value : null;
}

/** The text of a field from its text in SI units; what is not a number stays as it is. */
export function shownText(unit: string, text: string): string {
  const { factor } = unitOf(unit) ?? METRE;
  const value = typedNumber(text);
  return value === null || factor === 1 ? text : String(Number(inUnit(unit, value).toFixed(TYPED_DECIMALS)));
}

/**
 * The text in SI units from what was typed. The text that was shown before stays exactly the value that it was: a value that
 * nobody changed does not change by rounding.
 * @param before the text in SI units that was shown before.
 */
export function siText(unit: string, typed: string, before: string): string {
  if (typed.trim() === shownText(unit, before)) return before;
  const { factor } = unitOf(unit) ?? METRE;
  const value = typedNumber(typed);
  return value === null || factor === 1 ? typed : String(fromUnit(unit, value));
}
