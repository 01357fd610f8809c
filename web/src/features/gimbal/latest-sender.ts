/**
 * Sends a fast series of requests one at a time. A newer request replaces a waiting request; the last request is always
 * sent.
 */

export class LatestSender<T> {
  private waitingRequest: { value: T } | null = null;
  private busy = false;

  constructor(private readonly send: (value: T) => Promise<unknown>) {}

  push(value: T): void {
    this.waitingRequest = { value };
    if (!this.busy) void this.sendWaiting();
  }

  private async sendWaiting(): Promise<void> {
    this.busy = true;
    try {
      while (this.waitingRequest !== null) {
        const { value } = this.waitingRequest;
        this.waitingRequest = null;
        await this.send(value);
      }
    } finally {
      this.busy = false;
    }
  }
}
