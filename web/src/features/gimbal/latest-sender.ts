/**
 * Sends a fast series of requests one at a time. A newer request replaces a waiting request; the last request is always
 * sent.
 */

export class LatestSender<T> {
  private waiting: { value: T } | null = null;
  private busy = false;

  constructor(private readonly send: (value: T) => Promise<unknown>) {}

  push(value: T): void {
    this.waiting = { value };
    if (!this.busy) void this.sendWaiting();
  }

  private async sendWaiting(): Promise<void> {
    this.busy = true;
    try {
      while (this.waiting !== null) {
        const { value } = this.waiting;
        this.waiting = null;
        await this.send(value);
      }
    } finally {
      this.busy = false;
    }
  }
}
