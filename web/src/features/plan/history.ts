/** Undo and redo of whatever is edited: every state is kept whole (states share what did not change). Pure. */

const MOST = 300;

export interface History<T> {
  readonly past: readonly T[];
  readonly now: T;
  readonly future: readonly T[];
  /** Changes of one gesture or one field belong together and are undone at once. */
  readonly group: string | null;
}

export function begin<T>(now: T): History<T> {
  return { past: [], now, future: [], group: null };
}

/** @param group what the change belongs to; null: it stands alone. */
export function change<T>(history: History<T>, next: T, group: string | null = null): History<T> {
  if (next === history.now) return history;
  const joins = group !== null && group === history.group;
  return { past: joins ? history.past : [...history.past, history.now].slice(-MOST), now: next, future: [], group };
}

/** The gesture is over: the next change is undone for itself. */
export function seal<T>(history: History<T>): History<T> {
  return history.group === null ? history : { ...history, group: null };
}

export function undo<T>(history: History<T>): History<T> {
  const before = history.past.at(-1);
  if (before === undefined) return history;
  return { past: history.past.slice(0, -1), now: before, future: [history.now, ...history.future], group: null };
}

export function redo<T>(history: History<T>): History<T> {
  const [next, ...future] = history.future;
  if (next === undefined) return history;
  return { past: [...history.past, history.now], now: next, future, group: null };
}

/** The gesture is cancelled: as if its changes had never been. */
export function cancel<T>(history: History<T>, group: string): History<T> {
  return history.group === group ? { ...undo(history), future: [] } : history;
}
