/** Undo and redo. Each state is a complete value; states share their unchanged parts. Pure functions. */

const MAX_STATES = 300;

export interface History<T> {
  readonly past: readonly T[];
  readonly present: T;
  readonly future: readonly T[];
  /** Changes of one gesture or one field have the same group and are undone together. */
  readonly group: string | null;
}

export function begin<T>(present: T): History<T> {
  return { past: [], present, future: [], group: null };
}

/** @param group null: the change is undone alone. */
export function change<T>(history: History<T>, next: T, group: string | null = null): History<T> {
  if (next === history.present) return history;
  const isSameGroup = group !== null && group === history.group;
  return { past: isSameGroup ? history.past : [...history.past, history.present].slice(-MAX_STATES), present: next, future: [], group };
}

/** Ends a group: the next change is undone separately. */
export function endGroup<T>(history: History<T>): History<T> {
  return history.group === null ? history : { ...history, group: null };
}

export function undo<T>(history: History<T>): History<T> {
  const previous = history.past.at(-1);
  if (previous === undefined) return history;
  return { past: history.past.slice(0, -1), present: previous, future: [history.present, ...history.future], group: null };
}

export function redo<T>(history: History<T>): History<T> {
  const [next, ...future] = history.future;
  if (next === undefined) return history;
  return { past: [...history.past, history.present], present: next, future, group: null };
}

/** Removes the changes of a cancelled gesture. */
export function cancelGroup<T>(history: History<T>, group: string): History<T> {
  return history.group === group ? { ...undo(history), future: [] } : history;
}
