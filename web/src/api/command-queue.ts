/**
 * Sends one request to a vehicle at a time. Parallel requests can overtake each other: a renewal sent just before a new setpoint may
 * arrive after that setpoint and replace it. So each request waits for the response to the previous request. The wait is
 * limited, because a request that is sent late would move the vehicle unexpectedly.
 */

import type { Outcome } from './client';
import { unreachableProblem, type Problem } from './problems';

/** Longest wait for the responses to earlier requests [ms]. */
const MAX_WAIT_MS = 3000;

export class CommandQueue {
  private readonly lastRequests = new Map<string, Promise<unknown>>();

  /** Whether a request to at least one of these vehicles has no response yet. */
  busy(vehicles: readonly string[]): boolean {
    return vehicles.some((id) => this.lastRequests.has(id));
  }

  /**
   * Calls `send` after the server has answered all earlier requests to these vehicles; if that takes too long, returns a
   * problem and does not call `send`.
   */
  async run<T>(vehicles: readonly string[], send: () => Promise<Outcome<T>>): Promise<Outcome<T>> {
    const earlierRequests = Promise.allSettled(vehicles.map((id) => this.lastRequests.get(id)));
    const request = answeredInTime(earlierRequests).then((inTime) => (inTime ? send() : { ok: false as const, problem: notSentProblem() }));
    const allAnswered = Promise.allSettled([earlierRequests, request]).then(() => {
      for (const id of vehicles) if (this.lastRequests.get(id) === allAnswered) this.lastRequests.delete(id);
    });
    for (const id of vehicles) this.lastRequests.set(id, allAnswered);
    return request;
  }
}

/** Whether the server answers the requests within `MAX_WAIT_MS`. */
function answeredInTime(requests: Promise<unknown>): Promise<boolean> {
  return new Promise((resolve) => {
    const timer = setTimeout(() => resolve(false), MAX_WAIT_MS);
    void requests.then(() => {
      clearTimeout(timer);
      resolve(true);
    });
  });
}

function notSentProblem(): Problem {
  return {
    ...unreachableProblem(),
    title: 'Not sent',
    detail: 'The server has not answered an earlier request to this vehicle, so this request was not sent.',
  };
}
