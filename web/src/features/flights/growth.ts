/** Reads an open flight again and again while its logs are still being written. */

import type { FlightLibrary } from './library.svelte';
import type { LogView } from './log-view.svelte';

const PAUSE_MS = 5000;
/** Part of the time that reading may take: a long log takes longer to read each time. */
const READING_SHARE = 0.2;

/** @returns ends it. The reading that learns that all is written also reads the end. */
export function follow(library: Pick<FlightLibrary, 'load' | 'rows'>, view: Pick<LogView, 'flight' | 'refresh'>): () => void {
  let timer: ReturnType<typeof setTimeout>;
  let isEnded = false;

  async function read(): Promise<void> {
    const begun_ms = performance.now();
    await library.load();
    const shown = view.flight?.id;
    await view.refresh(library.rows.find(({ flight }) => flight !== null && flight.id === shown)?.flight ?? null);
    const pause_ms = Math.max(PAUSE_MS, (performance.now() - begun_ms) / READING_SHARE);
    if (!isEnded) timer = setTimeout(() => void read(), pause_ms);
  }
  timer = setTimeout(() => void read(), PAUSE_MS);
  return () => {
    isEnded = true;
    clearTimeout(timer);
  };
}
