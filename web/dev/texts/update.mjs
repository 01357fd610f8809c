/** `npm run texts`: writes the texts of the page's sources into the catalogs. `npm run check:texts`: fails if a catalog is out of date. */

import { existsSync, mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { collect, translations, WEB, written } from './catalog.mjs';

const LANGUAGE = 'de';
const onlyCheck = process.argv.includes('--check');
const folder = join(WEB, 'locales', LANGUAGE);
mkdirSync(folder, { recursive: true });

const existing = translations(LANGUAGE);
const { areas, doubtful } = collect();
let outdated = 0;
const used = new Set();
for (const [name, entries] of areas) {
  const file = join(folder, `${name}.po`);
  const text = written(LANGUAGE, entries, existing);
  for (const entry of entries) used.add(entry.text);
  if (existsSync(file) && readFileSync(file, 'utf8') === text) continue;
  outdated += 1;
  if (onlyCheck) console.error(`locales/${LANGUAGE}/${name}.po is not that of the sources: run \`npm run texts\`.`);
  else writeFileSync(file, text);
}
if (!onlyCheck) for (const [text, german] of existing) if (!used.has(text)) console.log(`no longer used: “${text}” = “${german}”`);
if (process.argv.includes('--doubtful')) console.log(doubtful.join('\n'));
if (onlyCheck && outdated > 0) process.exit(1);
