/** What the page says aloud. */

import { beforeEach, describe, expect, it, vi } from 'vitest';
import { stubBrowser } from '../../app/page.fixture';
import type { VehicleFacts } from '../../vehicle/facts';
import { heardOf, sentences, type Heard } from './voice';

stubBrowser();
vi.stubGlobal('matchMedia', () => ({ matches: false, addEventListener: () => undefined }));
const { page } = await import('../../app/page.svelte');
const { userSettings } = await import('../../app/settings.svelte');
const { Voice } = await import('./voice.svelte');

interface State {
  id?: string;
  lost?: boolean;
  armed?: boolean;
  mode_label?: string;
  remaining_percent?: number | null;
  homeDistance_m?: number | null;
}
function facts({ id = '1', lost = false, armed = true, mode_label = 'Hold', remaining_percent = 80, homeDistance_m = 0 }: State): VehicleFacts {
  const reading = <T>(value: T) => ({ value, age_s: 0 });
  return {
    id,
    lost,
    inAir: armed,
    status: reading({ armed, mode_label }),
    battery: reading({ remaining_percent }),
    homeDistance_m,
  } as unknown as VehicleFacts;
}

/** What is said while a vehicle goes through these states. */
function said(...states: readonly State[]): string[] {
  let before: Heard | null = null;
  return states.flatMap((state) => {
    const now = heardOf(facts(state), before);
    const texts = sentences(before, now);
    before = now;
    return texts;
  });
}

describe('the voice', () => {
  it('says changes, not the state that it finds', () => {
    expect(said({ armed: false, mode_label: 'Hold' })).toEqual([]);
    expect(said({ armed: false }, { mode_label: 'Takeoff' }, {})).toEqual(['Armed', 'Takeoff', 'Hold']);
    expect(said({}, { lost: true }, {})).toEqual(['Connection lost', 'Connected']);
    expect(said({}, { armed: false })).toEqual(['Disarmed']);
  });

  it('says nothing of the difference between two vehicles', () => {
    expect(said({}, { id: '2', armed: false, mode_label: 'Return', remaining_percent: 5, homeDistance_m: 900 })).toEqual([]);
  });

  it('says each level of the battery once, as it falls', () => {
    expect(
      said({}, { remaining_percent: 49 }, { remaining_percent: 31 }, { remaining_percent: 30 }, { remaining_percent: null }, { remaining_percent: 9 }),
    ).toEqual(['Battery 50 percent', 'Battery 30 percent', 'Battery 10 percent']);
    expect(said({ remaining_percent: 20 }, { remaining_percent: 90 })).toEqual([]); // another battery
  });

  it('says only what is wanted', () => {
    const heard = (percent: number, mode_label: string, before: Heard | null) =>
      heardOf(facts({ remaining_percent: percent, mode_label, homeDistance_m: 150 }), before);
    const [before, now] = [heard(80, 'Hold', null), heard(20, 'Return', null)];
    const all = ['Return', 'Battery 20 percent'];
    expect(sentences(before, now)).toEqual(all);
    expect(sentences(before, now, { mode: false })).toEqual(all.slice(1));
    expect(sentences(before, now, { battery: false, distance: false })).toEqual(all.slice(0, 1));
  });

  it('says each hundred metres on the way out, once a flight', () => {
    expect(said({}, { homeDistance_m: 99 }, { homeDistance_m: 101 }, { homeDistance_m: 98 }, { homeDistance_m: 102 }, { homeDistance_m: 350 })).toEqual([
      '100 metres from home',
      '300 metres from home',
    ]);
  });
});

describe('the speaker', () => {
  const spoken: string[] = [];
  const cancel = vi.fn();
  const message = (severity: number, vehicle: string | null, text: string) => ({ kind: 'event', vehicle, unix_s: 0, severity, text });

  beforeEach(() => {
    spoken.length = 0;
    userSettings.set('voice', null);
    cancel.mockClear();
    vi.useFakeTimers();
    vi.stubGlobal(
      'SpeechSynthesisUtterance',
      class {
        constructor(readonly text: string) {}
      },
    );
    vi.stubGlobal('speechSynthesis', { speak: ({ text }: { text: string }) => spoken.push(text), cancel });
  });

  it('is silent until it is switched on, and says what is wanted', () => {
    const voice = new Voice();
    voice.take(message(2, null, 'Failsafe activated'));
    expect(spoken).toEqual([]);
    voice.toggle();
    voice.take(message(4, null, 'Failsafe activated'));
    voice.take(message(6, null, 'Landing detected'));
    expect(spoken).toEqual(['Voice on', 'Failsafe activated']);
    userSettings.change('voice', { warnings: false });
    voice.take(message(2, null, 'Failsafe activated'));
    expect(spoken).toHaveLength(2);
    voice.toggle();
    expect(voice.on).toBe(false);
  });

  it('says of other vehicles only errors, with the name', () => {
    const voice = new Voice();
    voice.toggle();
    vi.spyOn(page, 'factsNow').mockReturnValue({ name: 'Quad 2' } as VehicleFacts);
    voice.take(message(4, '2', 'Low battery'));
    voice.take(message(2, '2', 'Motor failure'));
    expect(spoken).toEqual(['Voice on', 'Quad 2: Motor failure']);
  });

  it('drops old sentences rather than being late', () => {
    const voice = new Voice();
    voice.toggle();
    for (let i = 0; i < 6; i++) voice.take(message(3, null, `${i}`));
    expect(cancel).toHaveBeenCalledOnce();
    expect(spoken.at(-1)).toBe('5');
  });
});
