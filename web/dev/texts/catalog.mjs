/** The catalogs of texts in another language: gettext files in `locales/<language>/`, one for each part of the page. */

import { readdirSync, readFileSync } from 'node:fs';
import { join, relative } from 'node:path';
import PO from 'pofile';
import { comparedIn, textsOf } from './find.mjs';

export const WEB = new URL('../../', import.meta.url).pathname;
/** The texts of this server, which `tools/build_server_texts.py` collects, are in catalogs of their own. */
const SERVER = /^server/;

/** Catalog by path: the first that fits. A text that two of them need is in `shared`. */
const AREAS = [
  ['vehicle-room', /^src\/features\/(vehicle-room|params|shell|files|topics|simulator|gimbal\/setup)\//],
  ['plan-offboard', /^src\/features\/plan\/offboard\//],
  ['plan', /^src\/features\/plan\//],
  ['offboard', /^src\/(features\/offboard\/|vehicle\/)/],
  ['fly', /^src\/features\//],
  ['app', /^src\//],
];
const areaOf = (file) => AREAS.find(([, paths]) => paths.test(file))[0];

const isSource = (name) => /\.(ts|svelte)$/.test(name) && !/\.(test|fixture)\.ts$|\.d\.ts$/.test(name);
/** Generated tables of names: nothing of them is shown, and their names are compared. */
const NAMES = ['src/api/schema.d.ts', 'src/api/fields.ts', 'src/api/bounds.ts'];

function filesBelow(folder) {
  const names = readdirSync(folder, { recursive: true, withFileTypes: true }).filter((entry) => entry.isFile());
  return names.map((entry) => relative(WEB, join(entry.parentPath ?? entry.path, entry.name))).sort();
}

/** Every source file by path, and all strings that any of them compares. */
export function readSources() {
  const sources = new Map(
    filesBelow(join(WEB, 'src'))
      .filter(isSource)
      .map((file) => [file, readFileSync(join(WEB, file), 'utf8')]),
  );
  const compared = new Set();
  for (const file of NAMES) sources.set(file, readFileSync(join(WEB, file), 'utf8'));
  for (const [file, source] of sources) for (const one of comparedIn(source, file)) compared.add(one);
  for (const file of NAMES) sources.delete(file);
  return { sources, compared };
}

/** The page's texts by catalog: the text, the files that have it, and what its holes are. */
export function collect() {
  const { sources, compared } = readSources();
  const found = new Map();
  const doubtful = [];
  for (const [file, source] of sources) {
    const { texts, doubtful: more } = textsOf(source, file, compared);
    for (const { text, holes } of texts) {
      const entry = found.get(text) ?? {
        text,
        files: new Set(),
        holes: holes.map(({ start, end, test }) => source.slice((test ?? { start }).start, (test ?? { end }).end)),
      };
      found.set(text, entry);
      entry.files.add(file);
    }
    for (const { value, line } of more) doubtful.push(`${file}:${line}: “${value}”`);
  }
  const areas = new Map(['shared', ...AREAS.map(([name]) => name)].map((name) => [name, []]));
  for (const entry of found.values()) {
    const own = new Set([...entry.files].map(areaOf));
    areas.get(own.size === 1 ? [...own][0] : 'shared').push(entry);
  }
  return { areas, doubtful };
}

const catalogFiles = (language) => {
  const folder = join(WEB, 'locales', language);
  return readdirSync(folder)
    .filter((name) => name.endsWith('.po'))
    .map((name) => join(folder, name));
};

/** Translation by text, of all catalogs of a language; without those that nobody has translated yet. */
export function translations(language, { server = false } = {}) {
  const found = new Map();
  for (const file of catalogFiles(language)) {
    if (SERVER.test(file.split('/').at(-1)) !== server) continue;
    for (const { msgid, msgstr, obsolete } of PO.parse(readFileSync(file, 'utf8')).items) if (!obsolete && msgstr[0]) found.set(msgid, msgstr[0]);
  }
  return found;
}

/** Every sentence of the server that the catalogs of a language have. */
export function serverSentences(language) {
  const files = catalogFiles(language).filter((file) => SERVER.test(file.split('/').at(-1)));
  return files.flatMap((file) => PO.parse(readFileSync(file, 'utf8')).items.map(({ msgid }) => msgid));
}

/** A catalog as text, with the translations that exist. */
export function written(language, entries, existing) {
  const catalog = new PO();
  catalog.headers = { Language: language, 'MIME-Version': '1.0', 'Content-Type': 'text/plain; charset=utf-8', 'Content-Transfer-Encoding': '8bit' };
  for (const { text, files, holes } of entries) {
    const item = new PO.Item();
    item.msgid = text;
    item.msgstr = [existing.get(text) ?? ''];
    item.references = [...files];
    item.extractedComments = holes.map((hole, n) => `{${n}}: ${hole.replace(/\s+/g, ' ').slice(0, 120)}`);
    catalog.items.push(item);
  }
  return catalog.toString();
}
