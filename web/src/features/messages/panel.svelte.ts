/** The message panel: open or not, its filter, and the time up to which each vehicle's messages were read. */

import type { Filter } from './messages';

class MessagePanel {
  open = $state(false);
  filter = $state<Filter>('all');
  private readUntil = $state.raw<Readonly<Record<string, number>>>({});

  /** Messages from before the page was opened count as read. */
  since(vehicle: string, now_unix_s: number): number {
    return this.readUntil[vehicle] ?? (this.began_unix_s ??= now_unix_s);
  }

  read(vehicle: string, now_unix_s: number): void {
    this.readUntil = { ...this.readUntil, [vehicle]: now_unix_s };
  }

  private began_unix_s: number | null = null;
}

export const panel = new MessagePanel();
