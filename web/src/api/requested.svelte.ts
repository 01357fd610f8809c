/** A value that is requested from the server once for each key, however often it is asked for. */

import type { Outcome } from './client';
import type { Problem } from './problems';

export class Requested<T> {
  /** The answer for the present key; null: none yet, or the request failed. */
  value = $state.raw<T | null>(null);
  problem = $state.raw<Problem | null>(null);
  private key: string | null = null;
  private request: () => Promise<Outcome<T>> = () => Promise.reject(new Error('no request'));

  /** Requests the value if the key is another one than before. @param key what `request` asks for; null: nothing. */
  show(key: string | null, request: () => Promise<Outcome<T>>): void {
    if (key === this.key) return;
    [this.key, this.request] = [key, request];
    this.load();
  }

  /** Requests the value of the present key again. */
  load(): void {
    const { key } = this;
    [this.value, this.problem] = [null, null];
    if (key === null) return;
    void this.request().then((outcome) => {
      if (key !== this.key) return; // the answer to an earlier request
      if (outcome.ok) this.value = outcome.value;
      else this.problem = outcome.problem;
    });
  }
}
