/** Follows an operation of the server to its end. */

import type { ApiClient } from '../api/client';
import type { components } from '../api/schema';

export type Operation = components['schemas']['Operation'];

const POLL_MS = 500;

/** @param onChange is told each state; returns whether it is still wanted. @returns the last known state. */
export async function follow(api: ApiClient, begun: Operation, onChange: (operation: Operation) => boolean): Promise<Operation> {
  let current = begun;
  if (!onChange(current)) return current;
  while (current.state === 'running') {
    await new Promise((resolve) => setTimeout(resolve, POLL_MS));
    const response = await api.get('/operations/{o}', { params: { path: { o: current.id } } });
    if (!response.ok) break;
    current = response.value;
    if (!onChange(current)) break;
  }
  return current;
}
