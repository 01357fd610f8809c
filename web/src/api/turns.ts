/**
 * One order to a vehicle at a time. Requests travel side by side, so that a renewal sent just before a new order may
 * arrive after it, and would take it back: what is sent in turn waits for the answer to what was sent before.
 */
export class Turns {
  private readonly last = new Map<string, Promise<unknown>>();

  /** Whether an answer is still awaited for any of these vehicles. */
  busy(vehicles: readonly string[]): boolean {
    return vehicles.some((id) => this.last.has(id));
  }

  /** Calls `send` once all that was sent to these vehicles before has been answered. */
  async run<T>(vehicles: readonly string[], send: () => Promise<T>): Promise<T> {
    const mine = Promise.allSettled(vehicles.map((id) => this.last.get(id))).then(send);
    for (const id of vehicles) this.last.set(id, mine);
    try {
      return await mine;
    } finally {
      for (const id of vehicles) if (this.last.get(id) === mine) this.last.delete(id);
    }
  }
}
