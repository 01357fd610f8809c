import { describe, expect, it } from 'vitest';
import { ServerTexts, withTexts } from './server-text';

const TEXTS = new ServerTexts([
  ['Vehicle {0} is not armed.', 'Fahrzeug {0} ist nicht scharf.'],
  ['Vehicle {0} is not armed or {1}.', 'Fahrzeug {0} ist nicht scharf oder {1}.'],
  ['Arm it first.', 'Erst scharfschalten.'],
  ['{0} is at {1}.', 'Bei {1}: {0}.'],
  ['{0} the {1}', '{0} ({1})'],
  ['no home position', 'keine Home-Position'],
  ['the geofence', 'der Geofence'],
  ['There is no {0} {1}.', 'Es gibt keine {0} {1}.'],
  ['there is no mission', 'es gibt keine Mission'],
  ['Hold', 'Halten'],
  ['Switching to {0} because of {1}.', 'Wechsel zu {0} wegen: {1}.'],
]);

describe('a sentence of the server', () => {
  it.each([
    ['Arm it first.', 'Erst scharfschalten.'],
    ['Vehicle 3 is not armed.', 'Fahrzeug 3 ist nicht scharf.'],
    ['Vehicle 3 is not armed or lost.', 'Fahrzeug 3 ist nicht scharf oder lost.'],
    ['Switching to Hold because of no home position, the geofence.', 'Wechsel zu Halten wegen: keine Home-Position, der Geofence.'],
    ['Vehicle 3 is not armed. Arm it first.', 'Fahrzeug 3 ist nicht scharf. Erst scharfschalten.'],
    ['Vehicle 3 is not armed. Its maker says: xyz.', 'Fahrzeug 3 ist nicht scharf. Its maker says: xyz.'],
    ['Hold', 'Halten'],
    ['No home position.', 'Keine Home-Position.'],
    ['row 2: no home position.', 'row 2: keine Home-Position.'],
    ['There is no mission. Arm it first.', 'Es gibt keine Mission. Erst scharfschalten.'],
    ['field x: no home position (no fix).', 'field x: keine Home-Position (no fix).'],
  ])('%s', (english, german) => expect(TEXTS.text(english)).toBe(german));

  it('is shown as it is if it is not known, also if a template of few words would fit', () => {
    for (const text of ['Something else happened.', 'Fly over the old bridge', '', '12.5', 'x'.repeat(5000)]) expect(TEXTS.text(text)).toBe(text);
  });

  it('has parts in the language of the page and parts that are not, as what the vehicle itself says', () => {
    const shown = (text: string) => TEXTS.partsOf(TEXTS.text(text));
    expect(shown('Arm it first.')).toEqual([{ text: 'Erst scharfschalten.', isForeign: false }]);
    expect(shown('Compass 0 fault')).toEqual([{ text: 'Compass 0 fault', isForeign: true }]);
    expect(shown('Compass 1 fault. Arm it first.')).toEqual([
      { text: 'Compass 1 fault.', isForeign: true },
      { text: ' Erst scharfschalten.', isForeign: false },
    ]);
  });

  it('keeps numbers as they are', () => {
    expect(TEXTS.text('Vehicle 3.5e-3 is not armed.')).toBe('Fahrzeug 3.5e-3 ist nicht scharf.');
  });

  it('is found in no time, also if it was written to take long', () => {
    const begin = performance.now();
    for (let n = 0; n < 50; n += 1) TEXTS.text(`Vehicle ${'is not armed or '.repeat(100)}${n}`);
    expect(performance.now() - begin).toBeLessThan(500);
  });
});

describe('an answer of the server', () => {
  it('has its texts translated, and nothing that is compared or sent back', () => {
    const answer = {
      code: 'Hold',
      name: 'Hold',
      detail: 'Arm it first.',
      reasons: ['no home position'],
      values: [1, 2],
      document: { text: 'Hold' },
      at: { mode_label: 'Hold' },
      choice: { value: 1, label: 'Hold' },
      mode: { mode: 'hold', label: 'Hold' },
      span: { begin_s: 1, end_s: 2, name: 'Hold' },
      topic: { begin_s: 1, end_s: 2, name: 'Hold', samples: 3 },
    };
    expect(withTexts(answer, TEXTS)).toEqual({
      ...answer,
      detail: 'Erst scharfschalten.',
      reasons: ['keine Home-Position'],
      at: { mode_label: 'Halten' },
      mode: { mode: 'hold', label: 'Halten' },
      span: { begin_s: 1, end_s: 2, name: 'Halten' },
    });
  });
});
