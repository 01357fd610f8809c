/** The texts that are translated, and those that must not be: a wrong one would break a control in another language. */

import { describe, expect, it } from 'vitest';
import { collect, readSources, serverSentences, translations } from '../../dev/texts/catalog.mjs';
import { comparedIn, textsOf } from '../../dev/texts/find.mjs';
import { holesOf, translated } from '../../dev/texts/translate.mjs';
import { ServerTexts } from '../api/server-text';

const found = (source: string, file = 'part.ts', compared = comparedIn(source, file)): string[] =>
  textsOf(source, file, compared).texts.map(({ text }) => text);
const german = (source: string, texts: Record<string, string>, file = 'part.ts'): string =>
  translated(source, file, comparedIn(source, file), new Map(Object.entries(texts)));

describe('texts of scripts', () => {
  it('are sentences, with holes for what is computed', () => {
    expect(found('const a = `Vehicle ${id} is not armed.`;')).toEqual(['Vehicle {0} is not armed.']);
    expect(found("const a = 'Hold interrupts the mission.';")).toEqual(['Hold interrupts the mission.']);
  });

  it('have both words of a choice in the sentence', () => {
    expect(found("const a = `${n} ${n === 1 ? 'item' : 'items'} left`;")).toEqual(['{0} {1?item:items} left']);
  });

  it('are single words only as labels and names', () => {
    expect(found("const row = { label: 'unit', key: 'Speed', type: 'Polygon' };")).toEqual(['unit']);
    expect(found("const name = 'Battery'; const id = 'battery';")).toEqual(['Battery']);
  });

  it('are not keys, ids, addresses, headers, styles or names of events', () => {
    for (const code of [
      "if (event.key === 'Enter') go();",
      "switch (key) { case 'Escape': go(); }",
      "target.addEventListener('Some event', go);",
      "headers.set('Accept', 'application/json');",
      "const keys = { 'Shift L': go };",
      'const name = `Shift ${key.toUpperCase()}`;',
      'const path = `/vehicles/${id}/arm`;',
      "const font = '600 12px Inter, system-ui, sans-serif';",
      "const classes = 'btn-quiet first';",
      'const move = `translate(${x} ${y})`;',
      "type Mode = 'Hold mode' | 'Land mode'; const mode: Mode = 'Hold mode';",
    ])
      expect(found(code), code).toEqual([]);
  });

  it('are not words that are compared anywhere', () => {
    expect(found("const mode = 'Hold'; if (other === 'Hold') go();")).toEqual([]);
  });

  it('must not decide anything', () => {
    expect(() => comparedIn("if (row.label === 'Hold') go();", 'part.ts')).toThrow('compare an id');
  });
});

describe('texts of markup', () => {
  it('are whole sentences, over expressions and inline elements', () => {
    const source = '<p>Press <b>Space</b> to stop {name} and {#if two}both{/if}.</p>';
    expect(found(source, 'Part.svelte')).toEqual(['Press <0>Space</0> to stop {1} and {2}.', 'both']);
  });

  it('are also those that a person hears or sees on pointing', () => {
    expect(found('<button class="a b" aria-label="Stop {name}" title="Stops it" data-x="Some thing">x</button>', 'Part.svelte')).toEqual([
      'Stop {0}',
      'Stops it',
    ]);
  });
});

describe('a translation', () => {
  it('puts holes where its language needs them', () => {
    expect(german('const a = `Vehicle ${id} at ${place(x)}`;', { 'Vehicle {0} at {1}': 'Bei {1}: Fahrzeug {0}' })).toBe(
      'const a = `Bei ${place(x)}: Fahrzeug ${id}`;',
    );
    expect(german("const a = `${n} ${n === 1 ? 'item' : 'items'} left`;", { '{0} {1?item:items} left': 'noch {0} {1?Element:Elemente}' })).toBe(
      "const a = `noch ${n} ${n === 1 ? 'Element' : 'Elemente'}`;",
    );
    expect(
      german('<p>Press <b>Space</b> to stop {name}.</p>', { 'Press <0>Space</0> to stop {1}.': '{1} mit der <0>Leertaste</0> anhalten.' }, 'Part.svelte'),
    ).toBe('<p>{name} mit der <b>Leertaste</b> anhalten.</p>');
  });

  it('cannot leave its quotes', () => {
    expect(german("const a = 'Hold now';", { 'Hold now': "Halt' \\ ${x}" })).toBe("const a = 'Halt\\' \\\\ ${x}';");
    expect(german('const a = `Hold ${x} now`;', { 'Hold {0} now': '`${y}` {0}' })).toBe('const a = `\\`\\${y}\\` ${x}`;');
    expect(german('<p title="Hold now">Hold now</p>', { 'Hold now': '"{x}<b>' }, 'Part.svelte')).toBe(
      '<p title="&quot;&#123;x&#125;<b>">"&#123;x&#125;&lt;b></p>',
    );
  });

  it('inside another one is translated too', () => {
    expect(german('const a = `Flies ${far ? `to ${place} now` : why}.`;', { 'Flies {0}.': 'Fliegt {0}.', 'to {0} now': 'jetzt nach {0}' })).toBe(
      'const a = `Fliegt ${far ? `jetzt nach ${place}` : why}.`;',
    );
  });
});

describe('the German catalogs', () => {
  const existing = translations('de');

  it('have every hole of their texts, and no other', () => {
    for (const [text, words] of existing) {
      const [own, theirs] = [holesOf(text), holesOf(words)];
      // A choice between two words may be left out where German has one word for both.
      const needed = [...own].filter((hole) => !text.includes(`${hole}?`));
      expect(
        [...theirs].filter((hole) => !own.has(hole)),
        text,
      ).toEqual([]);
      expect(
        needed.filter((hole) => !theirs.has(hole)),
        text,
      ).toEqual([]);
    }
  });

  it('have every text', () => {
    const missing = [...collect().areas.values()].flat().filter(({ text }) => !existing.has(text));
    expect(missing.map(({ text }) => text)).toEqual([]);
  }, 60_000);

  it('have every sentence of the server', () => {
    const known = translations('de', { server: true });
    expect(serverSentences('de').filter((sentence) => !known.has(sentence))).toEqual([]);
  }, 60_000);

  it('have the sentences of refusals, findings, events and progress as the server writes them', () => {
    const texts = new ServerTexts(serverSentences('de').map((sentence) => [sentence, sentence.replace(/\p{L}/gu, '·')]));
    const english = [
      'COM_OBL_RC_ACT must be one of 0 (Position mode), 1 (Altitude mode); not 77.',
      "Dry run 3 has no corridor of the role 'lead'.",
      'Fly climbs to 200 m above home; the geofence limit is 80 m.',
      'Input: none. The gimbal takes no commands by MAVLink, from this page or from a program, because MNT_MODE_IN is 1.',
      'Item 1 (gimbal pitch yaw) ends the mission; 4 later items may never be reached.',
      'Item 2 (waypoint) is 200 m above home; the limit is 120 m. (16 times in this pattern)',
      'Opening x: the vehicle’s file system'.replace('’', "'") + ' refused the request (Is a directory).',
      'Reading a: error 175.',
      'PX4 refuses item 2 (command 82, frame 2).',
      'The flight takes 5 Wh (2 min), the battery provides 2 Wh with 20% in reserve.',
      'The straight path home of item 4 (return home) goes 49 m below the ground.',
      'The velocity (-900.0, 0.0, -9000.0) m/s is above the vehicle’s limits.'.replace('’', "'"),
      'row 2: 3 values for 4 columns.',
      'Vehicle 3 is not flying.',
      'Downloading log 3 of vehicle 1.',
      '1: connection lost',
      'Check the ros2:// link, and that the vehicle is disarmed; then try again.',
    ];
    expect(english.filter((sentence) => texts.text(sentence) === sentence)).toEqual([]);
  });

  it('leave every source without a catalog as it is', () => {
    const { sources, compared } = readSources();
    for (const [file, source] of sources) expect(translated(source, file, compared, new Map()), file).toBe(source);
  }, 60_000);
});
