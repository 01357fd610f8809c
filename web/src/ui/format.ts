/** Formats numbers for display. Unknown is "–", never 0. The minus sign is "−", and there is no −0.0. */

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

/** A length: one decimal below 100 m, no decimals from 100 m, kilometres from 10 000 m. */
export function metres(value: number | null | undefined): { text: string; unit: string } {
  if (!isKnown(value)) return { text: UNKNOWN, unit: 'm' };
  const magnitude = Math.abs(value);
  if (magnitude >= 9999.5) return { text: fixed(value / 1000, 1), unit: 'km' };
  return { text: fixed(value, magnitude < 99.95 ? 1 : 0), unit: 'm' };
}

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
