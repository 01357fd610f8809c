/**
 * One request per vehicle at a time. Parallel requests can overtake each other: a renewal sent just before a new setpoint may
 * arrive after that setpoint and undo it. So each request waits for the answer to the previous request, but not for
 * long: an old request must not move the vehicle unexpectedly.
 */

import type { Outcome } from './client';
import { unreachable } from './problems';

/** Longest wait for the answer to earlier requests [ms]. */
const MAX_WAIT_MS = 3000;

export class CommandQueue {
  private readonly last = new Map<string, Promise<unknown>>();

  /** Whether an answer is still awaited for any of these vehicles. */
  busy(vehicles: readonly string[]): boolean {
    return vehicles.some((id) => this.last.has(id));
  }

  /**
   * Calls `send` after all earlier requests to these vehicles have been answered; never calls it if they take too
   * long.
   */
  async run<T>(vehicles: readonly string[], send: () => Promise<Outcome<T>>): Promise<Outcome<T>> {
    const before = Promise.allSettled(vehicles.map((id) => this.last.get(id)));
    const mine = inTime(before).then((free) => (free ? send() : { ok: false as const, problem: notSent() }));
    const all = Promise.allSettled([before, mine]).then(() => {
      for (const id of vehicles) if (this.last.get(id) === all) this.last.delete(id);
    });
    for (const id of vehicles) this.last.set(id, all);
    return mine;
  }
}

function inTime(before: Promise<unknown>): Promise<boolean> {
  return new Promise((done) => {
    const timer = setTimeout(() => done(false), MAX_WAIT_MS);
    void before.then(() => {
      clearTimeout(timer);
      done(true);
    });
  });
}

function notSent(): ReturnType<typeof unreachable> {
  return { ...unreachable(), title: 'Not sent', detail: 'An earlier request to this vehicle has not been answered yet, so this one was not sent.' };
}
