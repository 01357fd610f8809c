/** The fields of an item in the editor. The suffix of a field's name gives its unit (`acceptance_radius_m`). Pure functions. */

import type { Item } from './document';
import { optionText, specsOf, type FieldSpec } from './item-fields';

export interface Field {
  readonly name: string;
  readonly label: string;
  readonly type: 'number' | 'choice';
  readonly value: number | string | null;
  readonly unit: string;
  readonly step: number;
  readonly min: number;
  readonly max: number;
  readonly decimals: number;
  /** The field may be empty; the editor then shows this text in the field. */
  readonly placeholder?: string;
  readonly options?: readonly { readonly value: string; readonly text: string }[];
}

/** Suffixes of field names, each with unit and step. The first match applies. */
const UNITS: readonly (readonly [string, string, number])[] = [
  ['_deg_s', '°/s', 1],
  ['_m_s', 'm/s', 0.5],
  ['_deg', '°', 1],
  ['_percent', '%', 1],
  ['_ms', 'ms', 10],
  ['_us', 'µs', 10],
  ['_hz', 'Hz', 1],
  ['_m', 'm', 1],
  ['_s', 's', 1],
];

/** Fields that count from 0 in the document and from 1 on the page. */
const ONE_BASED: ReadonlySet<string> = new Set(['target_index']);

export function fieldsOf(item: Item): Field[] {
  return specsOf(item.kind).flatMap(([name, spec]): Field[] => {
    if (spec.label === null || spec.appliesTo?.(item) === false) return [];
    const storedValue = item[name] === undefined ? spec.initial : item[name];
    const value = typeof storedValue === 'number' ? storedValue : null;
    const [, unit, step] = UNITS.find(([suffix]) => name.endsWith(suffix)) ?? ['', '', 1];
    const commonProperties = {
      name,
      label: spec.label,
      step: spec.step ?? step,
      unit: spec.unit?.(item) ?? unit,
      min: spec.min ?? -1e9,
      max: spec.max ?? 1e9,
      decimals: 3,
    };
    if (spec.options !== undefined)
      return [{ ...commonProperties, type: 'choice', value: String(value), options: optionsOf({ ...item, [name]: value }, name, spec) }];
    // A field without a value in an imported file stays empty until it is edited.
    const placeholder = spec.placeholder ?? (value === null ? 'not set' : undefined);
    return [
      {
        ...commonProperties,
        type: 'number',
        value: value === null ? null : value + (ONE_BASED.has(name) ? 1 : 0),
        ...(placeholder === undefined ? {} : { placeholder }),
      },
    ];
  });
}

/** The choices of an enum field: all enum values with a text, and the item's value even if it has no text. */
function optionsOf(item: Item, name: string, { options = {} }: FieldSpec): { value: string; text: string }[] {
  const choices = Object.entries(options).map(([value, text]) => ({ value, text }));
  const currentValue = String(item[name]);
  return options[currentValue] !== undefined ? choices : [...choices, { value: currentValue, text: optionText(item, name) ?? currentValue }];
}

export type ParsedNumber = { ok: true; value: number | null } | { ok: false; problem: string };

/** Parses a typed number with a decimal comma or point. Empty text is null if the field is optional. */
export function parseNumber(text: string, limits: { optional?: boolean; min?: number; max?: number } = {}): ParsedNumber {
  const normalizedText = text.trim().replace(',', '.').replace('−', '-');
  if (normalizedText === '') return limits.optional === true ? { ok: true, value: null } : { ok: false, problem: 'Enter a number.' };
  const value = Number(normalizedText);
  if (!Number.isFinite(value)) return { ok: false, problem: `“${text.trim()}” is not a number.` };
  const { min = -1e9, max = 1e9 } = limits;
  if (value < min || value > max) return { ok: false, problem: `Enter a number from ${min} to ${max}.` };
  return { ok: true, value };
}

/** Converts the displayed value of a field to the value in the document. */
export function toDocumentValue({ kind }: Pick<Item, 'kind'>, name: string, value: number | string | boolean | null): number | null {
  if (value === null || value === 'null') return null;
  const isInteger = specsOf(kind).find(([field]) => field === name)?.[1].integer === true;
  return (isInteger ? Math.round(Number(value)) : Number(value)) - (ONE_BASED.has(name) ? 1 : 0);
}
