/**
 * One order to a vehicle at a time. Requests travel side by side, so that a renewal sent just before a new order may
 * arrive after it, and would take it back: what is sent in turn waits for the answer to what was sent before. Not for
 * long: an order that a person gave and has forgotten must not move anything.
 */

import type { Outcome } from './client';
import { unreachable } from './problems';

/** So long an order waits for its turn [ms]. */
const PATIENCE_MS = 3000;

export class Turns {
  private readonly last = new Map<string, Promise<unknown>>();

  /** Whether an answer is still awaited for any of these vehicles. */
  busy(vehicles: readonly string[]): boolean {
    return vehicles.some((id) => this.last.has(id));
  }

  /** Calls `send` once all that was sent to these vehicles before has been answered; not at all if that takes too long. */
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
    const timer = setTimeout(() => done(false), PATIENCE_MS);
    void before.then(() => {
      clearTimeout(timer);
      done(true);
    });
  });
}

function notSent(): ReturnType<typeof unreachable> {
  return { ...unreachable(), title: 'Not sent', detail: 'What was sent to this vehicle before has had no answer yet, so this order was not sent.' };
}
