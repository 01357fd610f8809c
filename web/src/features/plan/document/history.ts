/** Undo and redo. Each state is a complete value; states share their unchanged parts. Pure. */

const MAX_STATES = 300;

export interface History<T> {
  readonly past: readonly T[];
  readonly now: T;
  readonly future: readonly T[];
  /** Changes of one gesture or one field have the same group and are undone together. */
  readonly group: string | null;
}

export function begin<T>(now: T): History<T> {
  return { past: [], now, future: [], group: null };
}

/** @param group null: the change is undone alone. */
export function change<T>(history: History<T>, next: T, group: string | null = null): History<T> {
  if (next === history.now) return history;
  const isSameGroup = group !== null && group === history.group;
  return { past: isSameGroup ? history.past : [...history.past, history.now].slice(-MAX_STATES), now: next, future: [], group };
}

/** Ends a group: the next change is undone separately. */
export function endGroup<T>(history: History<T>): History<T> {
  return history.group === null ? history : { ...history, group: null };
}

export function undo<T>(history: History<T>): History<T> {
  const previous = history.past.at(-1);
  if (previous === undefined) return history;
  return { past: history.past.slice(0, -1), now: previous, future: [history.now, ...history.future], group: null };
}

export function redo<T>(history: History<T>): History<T> {
  const [next, ...future] = history.future;
  if (next === undefined) return history;
  return { past: [...history.past, history.now], now: next, future, group: null };
}

/** Removes the changes of a cancelled gesture. */
export function cancel<T>(history: History<T>, group: string): History<T> {
  return history.group === group ? { ...undo(history), future: [] } : history;
}
