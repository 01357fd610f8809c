/** The vehicle's parameters as the page shows and edits them. Pure. */

import type { components } from '../../api/schema';

export type Parameters = components['schemas']['ParametersView'];
export type Parameter = components['schemas']['ParameterView'];
export type ParameterMetadata = NonNullable<Parameter['facts']>;

export interface Filter {
  text: string;
  /** Empty: all groups. */
  group: string;
  nonDefaultOnly: boolean;
}

export const NO_FILTER: Filter = { text: '', group: '', nonDefaultOnly: false };
/** Maximum number of rows that the panel shows, to keep the page fast. */
export const MAX_ROWS = 120;

/** The groups of the parameters, sorted. */
export function groupsOf(params: readonly Parameter[]): string[] {
  return [...new Set(params.map((p) => p.facts?.group ?? '').filter((g) => g !== ''))].sort((a, b) => a.localeCompare(b));
}

/** The parameters in whose name or description each typed word occurs. Names that begin with the first word come first. */
export function matchingParameters(params: readonly Parameter[], filter: Filter): Parameter[] {
  const words = filter.text
    .toLowerCase()
    .split(/\s+/)
    .filter((w) => w !== '');
  const matching = params.filter((p) => {
    if (filter.group !== '' && p.facts?.group !== filter.group) return false;
    if (filter.nonDefaultOnly && p.is_default !== false) return false;
    const text = `${p.name} ${p.facts?.title ?? ''}`.toLowerCase();
    return words.every((w) => text.includes(w));
  });
  const firstWord = words[0];
  if (firstWord === undefined) return matching;
  const rank = (p: Parameter): number => Number(!p.name.toLowerCase().startsWith(firstWord));
  return matching.sort((a, b) => rank(a) - rank(b) || a.name.localeCompare(b.name));
}

/** A number without the rounding noise of 32-bit floats. */
export function numberText(value: number | null, decimals: number | null = null): string {
  if (value === null) return '–';
  if (Number.isInteger(value) && decimals === null) return String(value).replace('-', '−');
  const rounded = Number(value.toPrecision(7));
  const text = decimals === null ? String(rounded) : withDecimals(value, Math.max(decimals, 0));
  return text.replace('-', '−');
}

/** The value with the given number of decimals, or with more decimals if the value needs them. */
function withDecimals(value: number, decimals: number): string {
  const exact = String(Number(value.toPrecision(7)));
  const neededDecimals = exact.includes('e') ? 0 : (exact.split('.')[1] ?? '').length;
  return neededDecimals > decimals ? exact : value.toFixed(decimals);
}

const UNIT_SYMBOLS: Readonly<Record<string, string>> = { deg: '°', Ohm: 'Ω', norm: '', us: 'µs', '%': '%' };

/** A unit of PX4's metadata, which is ASCII, with symbols such as ² and °. */
export function unitText(unit: string | null): string {
  if (unit === null) return '';
  return unit
    .split('/')
    .map((part) => UNIT_SYMBOLS[part] ?? part)
    .join('/')
    .replace('^2', '²')
    .replace('^3', '³');
}

/** The number with its unit; no space before a degree sign. */
function withUnit(number: string, unit: string | null): string {
  const symbol = unitText(unit);
  return symbol === '' ? number : symbol === '°' ? `${number}°` : `${number} ${symbol}`;
}

/** The value as text: the label of an enum value, the names of set bits, or the number with its unit. */
export function valueText(parameter: Parameter): string {
  const { facts, value } = parameter;
  if (facts === null || value === null) return numberText(value);
  const choice = facts.choices.find((c) => c.value === value);
  if (choice !== undefined) return choice.label;
  if (facts.bits.length > 0 && value > 0) {
    const setBits = facts.bits.filter((b) => Math.floor(value / 2 ** b.value) % 2 === 1).map((b) => b.label);
    if (setBits.length > 0) return setBits.join(', ');
  }
  const number = numberText(value, facts.is_integer ? null : facts.decimals);
  return withUnit(number, facts.unit);
}

/** The documented range as text; empty if none is documented. */
export function rangeText(facts: ParameterMetadata): string {
  if (facts.min !== null && facts.max !== null) return `${numberText(facts.min)} to ${withUnit(numberText(facts.max), facts.unit)}`;
  if (facts.min !== null) return `at least ${withUnit(numberText(facts.min), facts.unit)}`;
  return facts.max === null ? '' : `at most ${withUnit(numberText(facts.max), facts.unit)}`;
}

/** The number in a typed text; null if it is not a number, or if an integer is required and it is not an integer. */
export function parseTyped(text: string, isInteger: boolean): number | null {
  const normalized = text.trim().replace('−', '-').replace(',', '.');
  if (!/^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(normalized)) return null;
  const value = Number(normalized);
  return Number.isFinite(value) && (!isInteger || Number.isInteger(value)) ? value : null;
}

/** Why the metadata does not permit a value; null if it is permitted. The server makes the same check. */
export function valueProblem(facts: ParameterMetadata | null, value: number): string | null {
  if (facts === null) return null;
  if (facts.choices.length > 0) return facts.choices.some((c) => equalAsFloat32(c.value, value)) ? null : 'Not one of the documented values.';
  if (facts.bits.length > 0) {
    const knownBits = facts.bits.reduce((sum, b) => sum + 2 ** b.value, 0);
    const hasUnknownBits = [...Array(32).keys()].some((bit) => Math.floor(value / 2 ** bit) % 2 === 1 && Math.floor(knownBits / 2 ** bit) % 2 === 0);
    return value < 0 || hasUnknownBits ? 'This value sets undocumented bits.' : null;
  }
  const isTooLow = facts.min !== null && value < facts.min && !equalAsFloat32(value, facts.min);
  const isTooHigh = facts.max !== null && value > facts.max && !equalAsFloat32(value, facts.max);
  return isTooLow || isTooHigh ? `Outside the documented range: ${rangeText(facts)}.` : null;
}

/** Whether two values are equal as 32-bit floats, as the vehicle stores them. */
function equalAsFloat32(a: number, b: number): boolean {
  return Math.fround(a) === Math.fround(b);
}

/** Text about how far the server has read the parameters. */
export function stateText(list: Parameters['list'] | null): string {
  if (list === null || list.state === 'unknown') return 'not read yet';
  const progress = list.count === null ? '' : ` ${list.received} of ${list.count}`;
  switch (list.state) {
    case 'reading':
      return `reading${progress} …`;
    case 'failed':
      return `incomplete:${progress} received. Read again.`;
    case 'outdated':
      return `${list.received} parameters, read before the connection was lost`;
    default:
      return `${list.received} parameters${list.source === 'cache' ? ', from the server’s cache (unchanged on the vehicle)' : ''}`;
  }
}
