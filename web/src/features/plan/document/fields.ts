/** The fields of an item in the editor. The suffix of a field's name gives its unit (`acceptance_radius_m`). Pure functions. */

import type { Item } from './document';
import { boundsOf, quantityOf, type ShownField } from '../../../vehicle/fields';
import { optionText, specsOf, type FieldSpec } from './item-fields';

export interface Field extends ShownField {
  readonly name: string;
  readonly type: 'number' | 'choice';
}

/** Fields that count from 0 in the document and from 1 on the page. */
const ONE_BASED: ReadonlySet<string> = new Set(['target_index']);

export function fieldsOf(item: Item): Field[] {
  return specsOf(item.kind).flatMap(([name, spec]): Field[] => {
    if (spec.label === null || spec.appliesTo?.(item) === false) return [];
    const storedValue = item[name] === undefined ? spec.initial : item[name];
    const value = typeof storedValue === 'number' ? storedValue : null;
    const { scale: _, ...quantity } = quantityOf(name, ONE_BASED.has(name) ? {} : boundsOf(`kind_${item.kind}`, name));
    const commonProperties = {
      name,
      label: spec.label,
      ...quantity,
      ...spec.limits,
      step: spec.step ?? quantity.step,
      unit: spec.unit?.(item) ?? quantity.unit,
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

/** Converts the displayed value of a field to the value in the document. */
export function toDocumentValue({ kind }: Pick<Item, 'kind'>, name: string, value: number | string | boolean | null): number | null {
  if (value === null || value === 'null') return null;
  const isInteger = specsOf(kind).find(([field]) => field === name)?.[1].integer === true;
  return (isInteger ? Math.round(Number(value)) : Number(value)) - (ONE_BASED.has(name) ? 1 : 0);
}
