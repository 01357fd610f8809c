/**
 * The server's sentences in the page's language. The server writes English for every client; the German page looks each sentence up
 * as it comes in: whole, as a template with values, or sentence by sentence. What is not known stays as it is: nothing is lost.
 */

/** An English sentence, with `{0}` for each value, and its translation. */
export type ServerTextEntry = readonly [english: string, translation: string];

/** A part of a text that the page shows. */
export interface TextPart {
  readonly text: string;
  /** Whether it is not in the page's language. */
  readonly isForeign: boolean;
}

interface Template {
  /** What stands between the holes, and the number of the hole after each. */
  readonly literals: readonly string[];
  readonly holes: readonly number[];
  readonly translation: string;
  /** Whether so little of the template is fixed that its values must be known, too. */
  readonly weak: boolean;
}

const HOLE = /\{(\d+)\}/g;
/** A longer text is not looked up: it is a file or a list. */
const MAX_LENGTH = 2000;
const MAX_DEPTH = 4;
const MAX_KEPT = 2000;
/** Letters that the fixed parts of a template have at least, unless its values are known. */
const STRONG_LETTERS = 8;
/** Where texts are joined: sentences, and the parts of a list. */
const SENTENCE_END = /(?<=[.!?…]) (?=\P{Ll})/u;
const SEPARATORS = [SENTENCE_END, /; /, /, | and /];

function toTemplate([english, translation]: ServerTextEntry): Template {
  const parts = english.split(HOLE);
  const literals = parts.filter((_, n) => n % 2 === 0);
  return {
    literals,
    holes: parts.filter((_, n) => n % 2 === 1).map(Number),
    translation,
    weak: literals.join('').replace(/\P{L}/gu, '').length < STRONG_LETTERS,
  };
}

const longest = ({ literals }: Template): number => Math.max(...literals.map((literal) => literal.length));

/** The values of a text that a template fits; null: it does not fit. Each fixed part is searched once, so that no text takes long. */
function valuesOf({ literals, holes }: Template, text: string): Map<number, string> | null {
  const [first = '', last = ''] = [literals[0], literals.at(-1)];
  const end = text.length - last.length;
  if (!text.startsWith(first) || !text.endsWith(last) || first.length > end) return null;
  const values = new Map<number, string>();
  let at = first.length;
  for (const [n, hole] of holes.entries()) {
    const next = n === holes.length - 1 ? end : text.indexOf(literals[n + 1] ?? '', at);
    if (next < at || next > end) return null;
    values.set(hole, text.slice(at, next));
    at = next + (literals[n + 1] ?? '').length;
  }
  return values;
}

export class ServerTexts {
  private readonly whole = new Map<string, string>();
  /** The template of which most is fixed comes first. */
  private readonly templates: readonly Template[];
  private readonly kept = new Map<string, string>();
  /** Texts and sentences that were looked up in vain: the vehicle's own words. */
  private readonly foreign = new Set<string>();

  constructor(entries: readonly ServerTextEntry[]) {
    const isTemplate = ([english]: ServerTextEntry): boolean => english.search(HOLE) >= 0;
    for (const [english, translation] of entries.filter((entry) => !isTemplate(entry))) this.whole.set(english, translation);
    this.templates = entries
      .filter(isTemplate)
      .map(toTemplate)
      .sort((a, b) => longest(b) - longest(a) || b.literals.join('').length - a.literals.join('').length);
  }

  /** The sentence in the page's language, or as it is. */
  text(english: string): string {
    const kept = this.kept.get(english);
    if (kept !== undefined) return kept;
    if (this.kept.size >= MAX_KEPT) {
      this.kept.clear();
      this.foreign.clear();
    }
    const found = this.find(english, 0);
    if (found === null) this.foreign.add(english);
    const result = found ?? english;
    this.kept.set(english, result);
    return result;
  }

  /** The parts of a text that was looked up, in order: the page's language, and what stayed as it was. */
  partsOf(text: string): readonly TextPart[] {
    if (this.foreign.has(text)) return [{ text, isForeign: true }];
    const sentences = text.split(SENTENCE_END);
    if (!sentences.some((sentence) => this.foreign.has(sentence))) return [{ text, isForeign: false }];
    return sentences.map((sentence, n) => ({ text: n === 0 ? sentence : ` ${sentence}`, isForeign: this.foreign.has(sentence) }));
  }

  /** @returns null: no part of the text is known. */
  private find(text: string, depth: number): string | null {
    if (text.length > MAX_LENGTH || depth > MAX_DEPTH || !/\p{L}/u.test(text)) return null;
    const whole = this.exact(text) ?? this.sentences(text) ?? this.fromTemplate(text, depth) ?? this.trimmed(text, depth);
    if (whole !== null) return whole;
    for (const [n, separator] of SEPARATORS.entries()) {
      if (n === 1) {
        const placed = this.placed(text, depth);
        if (placed !== null || depth === 0) return placed; // a list is looked up only as a value of a sentence
      }
      const parts = text.split(separator);
      if (parts.length === 1) continue;
      const found = parts.map((part) => this.find(part, depth + 1));
      if (!found.some((part) => part !== null)) continue;
      if (n === 0) for (const [i, part] of parts.entries()) if (found[i] === null) this.foreign.add(part);
      return this.joined(text, separator, parts, found);
    }
    return null;
  }

  /** A whole text; also one that the server writes with a capital letter and a full stop, as PX4's checks. */
  private exact(text: string): string | null {
    const whole = this.whole.get(text);
    if (whole !== undefined) return whole;
    const end = text.endsWith('.') ? '.' : '';
    const inner = end === '' ? text : text.slice(0, -1);
    const stated = this.whole.get(inner);
    if (stated !== undefined) return stated + end;
    const small = this.whole.get(inner.charAt(0).toLowerCase() + inner.slice(1));
    return small === undefined ? null : small.charAt(0).toUpperCase() + small.slice(1) + end;
  }

  /** Several sentences of which each is a whole text: none of them is a value of a template that would fit, too. */
  private sentences(text: string): string | null {
    const found = text.split(SENTENCE_END).map((sentence) => this.exact(sentence));
    return found.length > 1 && found.every((each) => each !== null) ? found.join(' ') : null;
  }

  private trimmed(text: string, depth: number): string | null {
    const inner = text.trim();
    const found = inner === text ? null : this.find(inner, depth + 1);
    return found === null ? null : text.replace(inner, () => found);
  }

  /** A reason after its place or before a detail: `row 2: the file was refused (empty).`; also the reason alone with its full stop. */
  private placed(text: string, depth: number): string | null {
    if (text.endsWith('.')) {
      const stated = this.find(text.slice(0, -1), depth + 1);
      if (stated !== null) return `${stated}.`;
    }
    const [, reason, detail] = /^(.*) \((.*)\)$/.exec(text) ?? [];
    const found = reason === undefined ? null : this.find(reason, depth + 1);
    if (found !== null) return `${found} (${this.find(detail ?? '', depth + 1) ?? detail})`;
    for (let at = text.indexOf(': '); at > 0; at = text.indexOf(': ', at + 1)) {
      const after = this.find(text.slice(at + 2), depth + 1);
      const place = text.slice(0, at);
      if (after !== null) return `${this.find(place, depth + 1) ?? place}: ${after}`;
    }
    return null;
  }

  private joined(text: string, separator: RegExp, parts: readonly string[], found: readonly (string | null)[]): string {
    const joints = [...text.matchAll(new RegExp(separator, `g${separator.flags}`))].map(([joint]) => (joint === ' and ' ? ' und ' : joint));
    return parts.map((part, n) => (found[n] ?? part) + (joints[n] ?? '')).join('');
  }

  private fromTemplate(text: string, depth: number): string | null {
    for (const template of this.templates) {
      const values = valuesOf(template, text);
      if (values === null) continue;
      const known = new Map([...values].map(([hole, value]) => [hole, this.find(value, depth + 1)]));
      if (template.weak && [...values].some(([hole, value]) => known.get(hole) === null && / /.test(value.trim()))) continue;
      return template.translation.replace(HOLE, (_, hole) => known.get(Number(hole)) ?? values.get(Number(hole)) ?? '');
    }
    return null;
  }
}

/** Fields of the server's answers and frames whose texts a person reads; none of them is compared or sent back. */
const TEXT_FIELDS = new Set([
  'text',
  'detail',
  'message',
  'remedy',
  'reason',
  'reasons',
  'why',
  'cause',
  'problem',
  'problems',
  'warning',
  'warnings',
  'notes',
  'note',
  'mode_label',
  'title',
  'hint',
  'unavailable',
  'refusal',
  'progress',
  'limit',
  'if_stream_stops',
  'if_link_lost',
  'assumed',
  'cautions',
  'facts_problem',
  'fix',
  'left_out',
  'limited',
  'no_resume',
  'not_compared',
  'not_known',
  'outputs_problem',
  'stopped',
  'unreadable',
  'unusable',
  'why_not',
]);
/** Documents of persons, and what the vehicle has: sent back as they came. */
const OWN_FIELDS = new Set(['document', 'plan', 'items', 'steps', 'settings', 'shell', 'log']);

/** An answer or a frame with its texts in the page's language. */
export function withTexts<T>(data: T, texts: ServerTexts): T {
  const visit = (value: unknown, isText: boolean): unknown => {
    if (typeof value === 'string') return isText ? texts.text(value) : value;
    if (Array.isArray(value)) return typeof value[0] === 'number' ? value : value.map((one) => visit(one, isText));
    if (typeof value !== 'object' || value === null || Object.getPrototypeOf(value) !== Object.prototype) return value;
    // A mode has its name in the API and a label, of which a flight (with its greatest height) has a list, and how it ended as a code; a span of a log has its mode as name, a topic (with samples) its own. Other labels are of the vehicle's metadata. The readiness' `words` say whose words it has.
    const isShown = (name: string): boolean =>
      TEXT_FIELDS.has(name) ||
      (name === 'label' && 'mode' in value) ||
      (name === 'words' && 'after_s' in value) ||
      (name === 'modes' && 'height_m' in value) ||
      (name === 'name' && 'end_s' in value && !('samples' in value)) ||
      (name === 'ended' && !('height_m' in value));
    return Object.fromEntries(Object.entries(value).map(([name, one]) => [name, OWN_FIELDS.has(name) ? one : visit(one, isShown(name))]));
  };
  return visit(data, false) as T;
}

/** The language that this page was built in: in English, none of this module is in the page. */
declare const __LANGUAGE__: string;
let texts: ServerTexts | null = null;

/** Sets the translations, before anything is received. */
export function useServerTexts(entries: readonly ServerTextEntry[]): void {
  texts = new ServerTexts(entries);
}

/** The parts of a text that the server sent, for `app/ServerText.svelte`. */
export const partsOf = (text: string): readonly TextPart[] => (__LANGUAGE__ === 'en' || texts === null ? [{ text, isForeign: false }] : texts.partsOf(text));

/** What the server sent, with its texts in the page's language. */
export const inPageLanguage = <T>(data: T): T => (__LANGUAGE__ === 'en' || texts === null ? data : withTexts(data, texts));
