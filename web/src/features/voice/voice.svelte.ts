/** Says changes of the selected vehicle, and severe messages of all, by the browser's speech synthesis. Off until chosen. */

import { readLanguage } from '../../app/language';
import { page } from '../../app/page.svelte';
import { userSettings } from '../../app/settings.svelte';
import type { WireEvent } from '../../live/wire';
import { playTone } from './tone';
import { heardOf, isSevere, sentences, type Heard } from './voice';

const PERIOD_MS = 500;
/** Sentences that may wait; with more, the waiting ones are dropped, because they are no longer news. */
const MAX_WAITING = 4;

export class Voice {
  readonly on = $derived(userSettings.get('voice')?.on === true && this.canSpeak);
  private heard: Heard | null = null;
  private waiting = 0;

  /** Whether this browser can speak. */
  get canSpeak(): boolean {
    return 'speechSynthesis' in globalThis;
  }

  start(): void {
    setInterval(() => this.listen(), PERIOD_MS);
  }

  toggle(): boolean {
    if (!this.canSpeak) return false;
    userSettings.change('voice', { on: !this.on });
    if (this.on) this.say('Voice on');
    else speechSynthesis.cancel();
    return true;
  }

  /** Says a message of a vehicle or of the server. */
  take(event: WireEvent): void {
    const choice = userSettings.get('voice');
    const isSelected = event.vehicle === null || event.vehicle === page.selectedId;
    if (!isSevere(event.severity, isSelected)) return;
    if (choice?.tone === true) playTone();
    if (!this.on || choice?.warnings === false) return;
    const name = isSelected || event.vehicle === null ? '' : `${page.factsNow(event.vehicle)?.name ?? event.vehicle}: `;
    this.say(`${name}${event.text}`);
  }

  private listen(): void {
    const facts = !this.on || page.selectedId === null ? null : page.factsNow(page.selectedId);
    if (facts === null) {
      this.heard = null;
      return;
    }
    const now = heardOf(facts, this.heard);
    for (const sentence of sentences(this.heard, now, userSettings.get('voice') ?? {})) this.say(sentence);
    this.heard = now;
  }

  private say(text: string): void {
    if (this.waiting >= MAX_WAITING) {
      speechSynthesis.cancel(); // also ends each waiting sentence
      this.waiting = 0;
    }
    const utterance = new SpeechSynthesisUtterance(text);
    utterance.lang = readLanguage(); // a voice of another language would not be understood
    const end = (): void => void (this.waiting = Math.max(0, this.waiting - 1));
    utterance.onend = end;
    utterance.onerror = end;
    this.waiting += 1;
    speechSynthesis.speak(utterance);
  }
}

export const voice = new Voice();
