/** State of the message panel: open or closed, the filter, and for each vehicle the time up to which the person has read messages. */

import type { Filter } from './messages';

class MessagePanel {
  open = $state(false);
  filter = $state<Filter>('all');
  private readTimes = $state.raw<Readonly<Record<string, number>>>({});

  /** Time up to which the vehicle's messages count as read; initially the time of the first call. */
  readUntil_unix_s(vehicle: string, now_unix_s: number): number {
    return this.readTimes[vehicle] ?? (this.firstCall_unix_s ??= now_unix_s);
  }

  markRead(vehicle: string, now_unix_s: number): void {
    this.readTimes = { ...this.readTimes, [vehicle]: now_unix_s };
  }

  private firstCall_unix_s: number | null = null;
}

export const panel = new MessagePanel();
