/** Texts and filter of the MAVLink inspector. Pure functions. */

import type { components } from '../../api/schema';

export type Received = components['schemas']['ReceivedMessages'];
export type Message = components['schemas']['ReceivedMessage'];
export type Definition = components['schemas']['MessageDefinition'];
export type Field = components['schemas']['MessageField'];

/** A number, the list of an array, or a text; null: NaN. */
export type Value = number | string | null | readonly (number | null)[];

export const nameOf = (message: Message): string => message.name ?? `message ${message.id}`;
export const keyOf = (message: Message): string => `${message.component} ${message.id}`;
/** A number of a message as a field of a telemetry log; of several instances that of the newest. */
export function fieldOf(system: number, { name, component, instance }: Message, number: string): string {
  return `${name}:${system}.${component}${instance === null ? '' : `.${instance}`}/${number}`;
}

/** Messages whose name, number, component or fields contain each word. */
export function matching(messages: readonly Message[], search: string): Message[] {
  const words = search.toLowerCase().split(/\s+/).filter(Boolean);
  return messages.filter((message) => {
    const text = `${nameOf(message)} ${message.id} ${message.component} ${Object.keys(message.fields ?? {}).join(' ')}`.toLowerCase();
    return words.every((word) => text.includes(word));
  });
}

export function rateText(rate_hz: number | null): string {
  if (rate_hz === null) return '';
  return `${rate_hz < 10 ? rate_hz.toFixed(1) : rate_hz.toFixed(0)} Hz`;
}

/** The share of the messages of the vehicle that is lost [%]; null: nothing arrived yet. */
export function lost_percent(received: Received | null): number | null {
  let lost = 0;
  let all = 0;
  for (const each of received?.loss ?? []) {
    lost += each.lost;
    all += each.lost + each.received;
  }
  return all === 0 ? null : (100 * lost) / all;
}

/** The numbers of a message that can be plotted, with their values. */
export function numbersOf(fields: Readonly<Record<string, Value>>): [string, number | null][] {
  return Object.entries(fields).flatMap(([name, value]): [string, number | null][] => {
    if (Array.isArray(value)) return (value as readonly (number | null)[]).map((each, i) => [`${name}[${i}]`, each]);
    return typeof value === 'string' ? [] : [[name, value as number | null]];
  });
}

export function valueText(value: number | string | null): string {
  if (value === null) return 'NaN';
  if (typeof value === 'string') return value;
  return String(Number.isInteger(value) ? value : Number(value.toPrecision(7))).replace('-', '−');
}

export type Parsed = { readonly value: Value } | { readonly problem: string };

/** The value that a person has typed for a field; an empty text is 0. */
export function parse(field: Field, text: string): Parsed {
  if (field.type === 'char') return { value: text };
  const words = text.trim() === '' ? [] : field.length > 0 ? text.split(',') : [text];
  const values: (number | null)[] = [];
  for (const word of words) {
    const trimmed = word.trim().replace('−', '-');
    if (/^nan$/i.test(trimmed)) values.push(null);
    else if (trimmed === '' || !Number.isFinite(Number(trimmed))) return { problem: `${field.name}: ${word.trim()} is not a number.` };
    else values.push(Number(trimmed));
  }
  return { value: field.length > 0 ? values : values.length === 0 ? 0 : (values[0] ?? null) };
}
