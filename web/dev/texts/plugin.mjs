/** Builds the page in another language than English: each source is compiled with the texts of the catalogs, and nothing of it is left to the browser. */

import { relative } from 'node:path';
import { readSources, translations, WEB } from './catalog.mjs';
import { translated } from './translate.mjs';

const SERVER_TEXTS = 'virtual:server-texts';

/** @param {'en' | 'de'} language */
export function pageTexts(language) {
  const english = language === 'en';
  let compared, german;
  return {
    name: 'page-texts',
    enforce: 'pre',
    config: () => ({ define: { __LANGUAGE__: JSON.stringify(language) }, build: english ? {} : { emptyOutDir: false } }),
    buildStart() {
      if (english) return;
      compared = readSources().compared;
      german = translations(language);
    },
    resolveId: (id) => (id === SERVER_TEXTS ? `\0${SERVER_TEXTS}` : null),
    load: (id) => (id === `\0${SERVER_TEXTS}` ? `export default ${JSON.stringify(english ? [] : [...translations(language, { server: true })])};` : null),
    transform(code, id) {
      const file = relative(WEB, id);
      if (english || !/^src\/.*\.(ts|svelte)$/.test(file) || /\.test\.ts$/.test(file)) return null;
      return { code: translated(code, file, compared, german), map: null };
    },
    transformIndexHtml: (html) => (english ? html : html.replace('lang="en"', `lang="${language}"`)),
    generateBundle: {
      order: 'post',
      handler(_, bundle) {
        if (!english && bundle['index.html']) bundle['index.html'].fileName = `index.${language}.html`;
      },
    },
  };
}
