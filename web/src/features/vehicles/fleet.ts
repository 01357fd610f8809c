/** The list of vehicles: state texts, text search and filters. Pure functions. */

import type { VehicleFacts } from '../../vehicle/facts';

export type Filter = 'all' | 'flying' | 'attention';

export const FILTERS: readonly { value: Filter; text: string }[] = [
  { value: 'all', text: 'All' },
  { value: 'flying', text: 'Flying' },
  { value: 'attention', text: 'Needs attention' },
];

export type Sorting = 'number' | 'battery' | 'state';

export const SORTINGS: readonly { value: Sorting; text: string }[] = [
  { value: 'number', text: 'By number' },
  { value: 'battery', text: 'Lowest battery first' },
  { value: 'state', text: 'By state' },
];

/** The rows in another order; equal ones keep their order. A vehicle without a known charge comes last. */
export function sortedRows(rows: readonly Row[], sorting: Sorting): readonly Row[] {
  if (sorting === 'battery') return [...rows].sort((a, b) => (a.percent ?? Infinity) - (b.percent ?? Infinity));
  return sorting === 'state' ? [...rows].sort((a, b) => a.text.localeCompare(b.text)) : rows;
}

export interface Row {
  facts: VehicleFacts;
  /** Index in the whole fleet, which selects its identity colour. */
  index: number;
  /** State of the vehicle as a short text. */
  text: string;
  tone: 'danger' | 'caution' | 'dim';
  /** Remaining battery. */
  percent: number | null;
  batteryLow: boolean;
  flying: boolean;
  needsAttention: boolean;
}

const LOW_PERCENT = 25;

/** State of a vehicle. While the page has no connection to the server, the vehicle's connection is unknown. */
export function stateLabel(facts: VehicleFacts): { text: string; tone: Row['tone'] } {
  if (facts.offline) return { text: 'no connection to the server', tone: 'danger' };
  if (facts.lost) return { text: 'connection lost', tone: 'danger' };
  const status = facts.status?.value;
  if (status === undefined) return { text: '', tone: 'dim' };
  return { text: status.armed ? status.mode_label : 'disarmed', tone: 'dim' };
}

export function rowOf(facts: VehicleFacts, index: number): Row {
  const percent = facts.battery?.value.remaining_percent ?? null;
  const batteryLow = percent !== null && percent <= LOW_PERCENT;
  return {
    facts,
    index,
    ...stateLabel(facts),
    percent,
    batteryLow,
    flying: !facts.lost && facts.inAir && !facts.replayed,
    needsAttention: facts.lost || batteryLow,
  };
}

/** Whether the vehicle can be removed from the server: its connection is lost, and it is not a replay. */
export function canRemove(facts: VehicleFacts): boolean {
  return facts.lost && !facts.offline && !facts.replayed;
}

/** The rows that match text and filter, in unchanged order. */
export function matchingRows(rows: readonly Row[], text: string, filter: Filter): Row[] {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  return rows.filter((row) => {
    if (filter === 'flying' && !row.flying) return false;
    if (filter === 'attention' && !row.needsAttention) return false;
    const rowWords = `${row.facts.name} ${row.text}`.toLowerCase().split(/\s+/);
    return words.every((word) => row.facts.id.includes(word) || rowWords.some((rowWord) => rowWord.startsWith(word)));
  });
}

/** The index of the row that an arrow key selects; null for other keys. @param index the focused row; -1: none. */
export function rowAfterKey(index: number, count: number, key: string): number | null {
  if (count === 0) return null;
  switch (key) {
    case 'ArrowDown':
      return Math.min(count - 1, index + 1);
    case 'ArrowUp':
      return Math.max(0, index - 1);
    case 'Home':
      return 0;
    case 'End':
      return count - 1;
    default:
      return null;
  }
}

/**
 * Result of a Hold command, as text.
 * @param commanded number of vehicles to which Hold was sent.
 * @param unconfirmedNames names of the vehicles that did not confirm Hold.
 */
export function holdText(commanded: number, unconfirmedNames: readonly string[]): string {
  if (unconfirmedNames.length === 0) return commanded === 1 ? 'The vehicle switched to Hold.' : `All ${commanded} vehicles switched to Hold.`;
  const names = unconfirmedNames.slice(0, 5).join(', ') + (unconfirmedNames.length > 5 ? ` and ${unconfirmedNames.length - 5} more` : '');
  return `${commanded - unconfirmedNames.length} of ${commanded} vehicles switched to Hold. Not confirmed: ${names}.`;
}
