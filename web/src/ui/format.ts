/** Formats numbers for display. Unknown is "–", never 0. The minus sign is "−", and there is no −0.0. */

import { decimalsIn, distanceUnit, inUnit, M_PER_FT, M_PER_MI, M_PER_NMI, unitText } from './units';

export const UNKNOWN = '–';

export const DEG_PER_RAD = 180 / Math.PI;

function isKnown(value: number | null | undefined): value is number {
  return value !== null && value !== undefined && Number.isFinite(value);
}

/** A number with fixed decimals; `signed` adds a + to positive values. */
export function fixed(value: number | null | undefined, decimals: number, signed = false): string {
  if (!isKnown(value)) return UNKNOWN;
  const text = Math.abs(value).toFixed(decimals);
  const isZero = Number(text) === 0;
  if (value < 0 && !isZero) return `−${text}`;
  return signed && !isZero ? `+${text}` : text;
}

export interface Shown {
  text: string;
  unit: string;
}

/** A value in its chosen unit, with the decimals that it has in SI units. */
export function shown(quantity: string, value: number | null | undefined, decimals = 1, signed = false): Shown {
  return { text: isKnown(value) ? fixed(inUnit(quantity, value), decimalsIn(quantity, decimals), signed) : UNKNOWN, unit: unitText(quantity) };
}

export const joinedText = ({ text, unit }: Shown): string => `${text} ${unit}`;

/** A value with its unit as text: 12.3 m, 40.4 ft. */
export const heightText = (value_m: number | null | undefined, decimals = 1): string => joinedText(shown('height', value_m, decimals));
/** A length that is short, such as a radius; `distanceText` has longer units. */
export const lengthText = (value_m: number | null | undefined, decimals = 1): string => joinedText(shown('length', value_m, decimals));
export const speedText = (value_m_s: number | null | undefined, decimals = 1): string => joinedText(shown('speed', value_m_s, decimals));

/** A value with one decimal at most, without a zero: 12 m, 12.5 m. */
export function shortText(quantity: string, value: number): string {
  const text = fixed(inUnit(quantity, value), 1).replace(/\.0$/, '');
  return quantity === '' ? text : `${text} ${unitText(quantity)}`;
}

/** A distance: one decimal below 100 m, no decimals from 100 m, kilometres from 10 000 m; or in ft and mi, or nmi from half a mile. */
export function distance(value_m: number | null | undefined): Shown {
  if (!isKnown(value_m)) return { text: UNKNOWN, unit: unitText('length') };
  const magnitude_m = Math.abs(value_m);
  const unit = distanceUnit();
  if (unit === 'm' && magnitude_m >= 9999.5) return { text: fixed(value_m / 1000, 1), unit: 'km' };
  if (unit === 'ft' && magnitude_m >= M_PER_MI) return { text: fixed(value_m / M_PER_MI, 2), unit: 'mi' };
  if (unit === 'nmi' && magnitude_m >= M_PER_NMI / 2) return { text: fixed(value_m / M_PER_NMI, 2), unit: 'nmi' };
  return shown('length', value_m, Math.abs(inUnit('length', value_m)) < 99.95 ? 1 : 0);
}

export const distanceText = (value_m: number | null | undefined): string => joinedText(distance(value_m));

/** The units of round lengths for scales and grids, each from its length on: 20 m; 500 ft, 2 mi; 50 m, 0.5 nmi. */
function roundUnits(): readonly { readonly from_m: number; readonly m: number; readonly text: string }[] {
  const unit = distanceUnit();
  const text = unitText('length');
  const short = { from_m: 0, m: text === 'ft' ? M_PER_FT : 1, text };
  if (unit === 'nmi') return [short, { from_m: M_PER_NMI / 10, m: M_PER_NMI, text: unit }];
  return unit === 'ft' ? [short, { from_m: M_PER_MI, m: M_PER_MI, text: 'mi' }] : [short];
}

/** The unit of round lengths that are this long. */
function unitFrom(length_m: number): { readonly m: number; readonly text: string } {
  return (
    roundUnits()
      .filter(({ from_m }) => from_m <= length_m)
      .at(-1) ?? { m: 1, text: 'm' }
  );
}

/** The largest length of at most `most_m` that is 1, 2 or 5 times a power of ten in its unit. */
export function roundLengthBelow_m(most_m: number): number {
  const { m } = unitFrom(most_m);
  const power = 10 ** Math.floor(Math.log10(most_m / m) + 1e-9);
  return ([5, 2, 1].find((factor) => factor * power * m <= most_m * (1 + 1e-9)) ?? 1) * power * m;
}

/** The smallest power of ten of a unit, at least one of the shortest, of at least `least_m`. */
export function roundLengthAbove_m(least_m: number): number {
  const units = roundUnits();
  const lengths = units.map(({ from_m, m }, i) => {
    const length_m = m * 10 ** Math.max(i === 0 ? 0 : Math.log10(from_m / m), Math.ceil(Math.log10(least_m / m) - 1e-9));
    return length_m > (units[i + 1]?.from_m ?? Infinity) ? Infinity : length_m;
  });
  return Math.min(...lengths);
}

/** A round length as text: "50 m", "2 km", "500 ft". */
export function roundLengthText(length_m: number): string {
  const { m, text } = unitFrom(Math.abs(length_m) * (1 + 1e-9));
  return text === 'm' && Math.abs(length_m) >= 1000
    ? `${+(length_m / 1000).toFixed(3)} km`
    : `${+(length_m / m).toFixed(m > M_PER_FT && m !== 1 ? 2 : 3)} ${text}`;
}

/** An area: m², hectares from one hectare, km² from one square kilometre; with ft as the unit of distances, ft² and acres. */
export function areaText(area_m2: number): string {
  if (distanceUnit() === 'ft') return area_m2 >= M2_PER_ACRE ? `${fixed(area_m2 / M2_PER_ACRE, 2)} ac` : `${fixed(area_m2 / M_PER_FT ** 2, 0)} ft²`;
  if (area_m2 >= 1e6) return `${fixed(area_m2 / 1e6, 2)} km²`;
  return area_m2 >= 1e4 ? `${fixed(area_m2 / 1e4, 2)} ha` : `${fixed(area_m2, area_m2 < 100 ? 1 : 0)} m²`;
}
const M2_PER_ACRE = 4046.8564224;

/** Heading 000–359 from any angle [deg]. */
export function heading(value_deg: number | null | undefined): string {
  if (!isKnown(value_deg)) return UNKNOWN;
  const rounded = ((Math.round(value_deg) % 360) + 360) % 360;
  return String(rounded).padStart(3, '0');
}

/** mm:ss, or h:mm:ss from one hour. */
export function duration(value_s: number | null | undefined): string {
  if (!isKnown(value_s) || value_s < 0) return UNKNOWN;
  const s = Math.floor(value_s);
  const twoDigits = (n: number): string => String(n).padStart(2, '0');
  const minutes = `${twoDigits(Math.floor(s / 60) % 60)}:${twoDigits(s % 60)}`;
  return s >= 3600 ? `${Math.floor(s / 3600)}:${minutes}` : minutes;
}

/** A duration in a sentence or list, where mm:ss could be a time of day: 45 s, 12 min 30 s, 1 h 02 min. */
export function durationText(value_s: number | null | undefined): string {
  if (!isKnown(value_s) || value_s < 0) return UNKNOWN;
  const s = Math.floor(value_s);
  const twoDigits = (n: number): string => String(n).padStart(2, '0');
  if (s >= 3600) return `${Math.floor(s / 3600)} h ${twoDigits(Math.floor(s / 60) % 60)} min`;
  return s >= 60 ? `${Math.floor(s / 60)} min ${twoDigits(s % 60)} s` : `${s} s`;
}

/** Wall-clock time of day, 14:02:31. */
export function timeOfDay(unix_s: number): string {
  const date = new Date(unix_s * 1000);
  return [date.getHours(), date.getMinutes(), date.getSeconds()].map((n) => String(n).padStart(2, '0')).join(':');
}

/** Date and time of day in this computer's time zone: 2026-07-11 14:02:31. */
export function dateTime(unix_s: number): string {
  const d = new Date(unix_s * 1000);
  const twoDigits = (n: number): string => String(n).padStart(2, '0');
  return `${d.getFullYear()}-${twoDigits(d.getMonth() + 1)}-${twoDigits(d.getDate())} ${timeOfDay(unix_s)}`;
}

export function toDeg(value_rad: number | null | undefined): number | null {
  return isKnown(value_rad) ? value_rad * DEG_PER_RAD : null;
}

/** An angle wrapped to −180…180 [deg]. */
export function wrap180(value_deg: number): number {
  return ((((value_deg + 180) % 360) + 360) % 360) - 180;
}

/** Joins the texts that are not empty or unknown, for example "14 · 0.8 m". */
export function join(parts: readonly (string | null | undefined)[], separator = ' · '): string {
  const texts = parts.filter((p): p is string => p !== null && p !== undefined && p !== '' && p !== UNKNOWN);
  return texts.length === 0 ? UNKNOWN : texts.join(separator);
}

/** A file size as text, for example 12 MB. */
export function sizeText(bytes: number): string {
  if (bytes < 1000) return `${bytes} B`;
  const units = ['kB', 'MB', 'GB'];
  let value = bytes / 1000;
  while (value >= 999.5 && units.length > 1) {
    value /= 1000;
    units.shift();
  }
  return `${value.toFixed(value < 9.95 ? 1 : 0)} ${units[0]}`;
}
