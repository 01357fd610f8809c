/** The vehicle's parameters as the page shows and edits them. Pure functions. */

import { parseTyped } from '../../vehicle/fields';
import type { components } from '../../api/schema';

export type Parameters = components['schemas']['ParametersView'];
export type Parameter = components['schemas']['ParameterView'];
export type ParameterMetadata = NonNullable<Parameter['facts']>;

export interface Filter {
  text: string;
  /** Empty: all groups. */
  group: string;
  nonDefaultOnly: boolean;
  favouritesOnly: boolean;
}

export const NO_FILTER: Filter = { text: '', group: '', nonDefaultOnly: false, favouritesOnly: false };
/** Maximum number of rows that the panel shows, to keep the page fast. */
export const MAX_ROWS = 120;

/** The groups of the parameters, sorted. */
export function groupsOf(params: readonly Parameter[]): string[] {
  return [...new Set(params.map((p) => p.facts?.group ?? '').filter((g) => g !== ''))].sort((a, b) => a.localeCompare(b));
}

/** The parameters whose name or description contains all typed words. Names that begin with the first word come first. */
export function matchingParameters(params: readonly Parameter[], filter: Filter, favourites: ReadonlySet<string> = new Set()): Parameter[] {
  const words = filter.text
    .toLowerCase()
    .split(/\s+/)
    .filter((w) => w !== '');
  const matchingParams = params.filter((p) => {
    if (filter.group !== '' && p.facts?.group !== filter.group) return false;
    if (filter.nonDefaultOnly && p.is_default !== false) return false;
    if (filter.favouritesOnly && !favourites.has(p.name)) return false;
    const text = `${p.name} ${p.facts?.title ?? ''}`.toLowerCase();
    return words.every((w) => text.includes(w));
  });
  const firstWord = words[0];
  if (firstWord === undefined) return matchingParams;
  const rank = (p: Parameter): number => Number(!p.name.toLowerCase().startsWith(firstWord));
  return matchingParams.sort((a, b) => rank(a) - rank(b) || a.name.localeCompare(b.name));
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
  const exactText = String(Number(value.toPrecision(7)));
  const neededDecimals = exactText.includes('e') ? 0 : (exactText.split('.')[1] ?? '').length;
  return neededDecimals > decimals ? exactText : value.toFixed(decimals);
}

const UNIT_SYMBOLS: Readonly<Record<string, string>> = { deg: '°', Ohm: 'Ω', norm: '', us: 'µs', '%': '%' };

/** A unit from PX4's metadata, with symbols: `m^2` becomes `m²`, `deg` becomes `°`. */
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
  const { facts: metadata, value } = parameter;
  if (metadata === null || value === null) return numberText(value);
  const choice = metadata.choices.find((c) => c.value === value);
  if (choice !== undefined) return choice.label;
  if (metadata.bits.length > 0 && value > 0) {
    const setBits = metadata.bits.filter((b) => Math.floor(value / 2 ** b.value) % 2 === 1).map((b) => b.label);
    if (setBits.length > 0) return setBits.join(', ');
  }
  const number = numberText(value, metadata.is_integer ? null : metadata.decimals);
  return withUnit(number, metadata.unit);
}

/** The documented range as text; empty if none is documented. */
export function rangeText(metadata: ParameterMetadata): string {
  if (metadata.min !== null && metadata.max !== null) return `${numberText(metadata.min)} to ${withUnit(numberText(metadata.max), metadata.unit)}`;
  if (metadata.min !== null) return `at least ${withUnit(numberText(metadata.min), metadata.unit)}`;
  return metadata.max === null ? '' : `at most ${withUnit(numberText(metadata.max), metadata.unit)}`;
}

/** The number in a typed text; null if the text is not a number, or not an integer where `isInteger` requires one. */
export function parseTypedNumber(text: string, isInteger: boolean): number | null {
  const value = parseTyped(text);
  return value !== null && (!isInteger || Number.isInteger(value)) ? value : null;
}

/** Why the metadata does not permit a value; null: the value is permitted. The server makes the same check. */
export function valueProblem(metadata: ParameterMetadata | null, value: number): string | null {
  if (metadata === null) return null;
  if (metadata.choices.length > 0) return metadata.choices.some((c) => equalAsFloat32(c.value, value)) ? null : 'Not one of the documented values.';
  if (metadata.bits.length > 0) {
    const knownBits = metadata.bits.reduce((sum, b) => sum + 2 ** b.value, 0);
    const hasUnknownBits = [...Array(32).keys()].some((bit) => Math.floor(value / 2 ** bit) % 2 === 1 && Math.floor(knownBits / 2 ** bit) % 2 === 0);
    return value < 0 || hasUnknownBits ? 'This value sets undocumented bits.' : null;
  }
  const isTooLow = metadata.min !== null && value < metadata.min && !equalAsFloat32(value, metadata.min);
  const isTooHigh = metadata.max !== null && value > metadata.max && !equalAsFloat32(value, metadata.max);
  return isTooLow || isTooHigh ? `Outside the documented range: ${rangeText(metadata)}.` : null;
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
