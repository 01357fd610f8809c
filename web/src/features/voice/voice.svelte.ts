/** Says changes of the selected vehicle, and severe messages of all, by the browser's speech synthesis. Off until chosen. */

import { availableStorage } from '../../app/identity';
import { page } from '../../app/page.svelte';
import type { WireEvent } from '../../live/wire';
import { heardOf, SAID_OF_ANY, SAID_OF_SELECTED, sentences, type Heard } from './voice';

const KEY = 'gcs-voice';
const PERIOD_MS = 500;
/** Sentences that may wait; with more, the waiting ones are dropped, because they are no longer news. */
const MAX_WAITING = 4;

export class Voice {
  on = $state(false);
  private heard: Heard | null = null;
  private waiting = 0;
  private timer: ReturnType<typeof setInterval> | undefined;

  constructor(private readonly storage: Pick<Storage, 'getItem' | 'setItem' | 'removeItem'>) {
    if (storage.getItem(KEY) === 'on') this.start();
  }

  /** Whether this browser can speak. */
  get canSpeak(): boolean {
    return 'speechSynthesis' in globalThis;
  }

  toggle(): boolean {
    if (!this.canSpeak) return false;
    if (this.on) {
      this.on = false;
      clearInterval(this.timer);
      this.storage.removeItem(KEY);
      speechSynthesis.cancel();
    } else {
      this.storage.setItem(KEY, 'on');
      this.start();
      this.say('Voice on');
    }
    return true;
  }

  /** Says a message of a vehicle or of the server. */
  take(event: WireEvent): void {
    if (!this.on || typeof event.severity !== 'number') return;
    const isSelected = event.vehicle === null || event.vehicle === page.selectedId;
    if (event.severity > (isSelected ? SAID_OF_SELECTED : SAID_OF_ANY)) return;
    const name = isSelected || event.vehicle === null ? '' : `${page.factsNow(event.vehicle)?.name ?? event.vehicle}: `;
    this.say(`${name}${event.text}`);
  }

  private start(): void {
    if (!this.canSpeak) return;
    this.on = true;
    this.heard = null;
    this.timer = setInterval(() => this.listen(), PERIOD_MS);
  }

  private listen(): void {
    const facts = page.selectedId === null ? null : page.factsNow(page.selectedId);
    if (facts === null) return;
    const now = heardOf(facts, this.heard);
    for (const sentence of sentences(this.heard, now)) this.say(sentence);
    this.heard = now;
  }

  private say(text: string): void {
    if (this.waiting >= MAX_WAITING) {
      speechSynthesis.cancel(); // also ends each waiting sentence
      this.waiting = 0;
    }
    const utterance = new SpeechSynthesisUtterance(text);
    const end = (): void => void (this.waiting = Math.max(0, this.waiting - 1));
    utterance.onend = end;
    utterance.onerror = end;
    this.waiting += 1;
    speechSynthesis.speak(utterance);
  }
}

export const voice = new Voice(availableStorage(() => localStorage));
