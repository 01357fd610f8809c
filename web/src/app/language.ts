/**
 * The page's language. Each language is a build of its own (`dev/texts/plugin.mjs`), so that English pays nothing for the others.
 * The choice is a cookie, not local storage: the server reads it and sends the page and the
 * sign-in page of that language; without a choice, those of the browser's own language.
 */

export type Language = 'en' | 'de';

/** The languages, by their own names. */
export const LANGUAGES: Readonly<Record<Language, string>> = { en: 'English', de: 'Deutsch' };

const COOKIE = 'gcs-language';
const YEAR_S = 31_536_000;

/** The language that this page was built in. */
declare const __LANGUAGE__: Language;

export const readLanguage = (): Language => __LANGUAGE__;

/** A label inside a sentence: English has a small letter there, German nouns keep their capital. */
export const inSentence = (label: string): string => (__LANGUAGE__ === 'en' ? label.toLowerCase() : label);

/** The language of the pages that this browser loads from now on. */
export function keepLanguage(language: string | null): void {
  if (language !== null && Object.hasOwn(LANGUAGES, language)) document.cookie = `${COOKIE}=${language}; Path=/; Max-Age=${YEAR_S}; SameSite=Lax`;
}

/** Chooses the language of this browser and loads the page again: texts are fixed when the page loads. */
export function chooseLanguage(language: Language): void {
  keepLanguage(language);
  location.reload();
}
