/** Writes a source file with its texts in another language: what the build for that language compiles. */

import { textsOf } from './find.mjs';

/** A hole of a translation: `{0}`, or `{0?words:words}` where the source chooses between two words, or `<0>` and `</0>` around what an element encloses. */
const HOLE = /\{(\d+)(?:\?([^{}:]*):([^{}]*))?\}|<(\/?)(\d+)>/g;

const literal = (text) => `'${text.replace(/\\/g, '\\\\').replace(/'/g, "\\'").replace(/\n/g, '\\n')}'`;
const ESCAPES = {
  string: (text) => text,
  template: (text) => text.replace(/[\\`]|\$(?=\{)/g, '\\$&'),
  markup: (text) => text.replace(/[{}<]/g, (sign) => ({ '{': '&#123;', '}': '&#125;', '<': '&lt;' })[sign]),
  attribute: (text) => text.replace(/[{}"]/g, (sign) => ({ '{': '&#123;', '}': '&#125;', '"': '&quot;' })[sign]),
};

/** The numbers of a text's holes, to compare a translation's with the source's. */
export const holesOf = (text) => new Set([...text.matchAll(HOLE)].map((match) => (match[5] === undefined ? `{${match[1]}` : `<${match[4]}${match[5]}`)));

function replacement({ kind, holes }, german, slice) {
  if (kind === 'string') return literal(german);
  const escape = ESCAPES[kind];
  let [result, last] = ['', 0];
  for (const match of german.matchAll(HOLE)) {
    const [whole, number, first, second, closing, element] = match;
    const hole = holes[Number(number ?? element)];
    result += escape(german.slice(last, match.index));
    last = match.index + whole.length;
    if (element !== undefined) result += closing ? slice(hole.close.start, hole.close.end) : slice(hole.start, hole.end);
    else {
      const code = first === undefined ? slice(hole.start, hole.end) : `${slice(hole.test.start, hole.test.end)} ? ${literal(first)} : ${literal(second)}`;
      const isNode = kind !== 'template' && first === undefined;
      result += isNode ? code : kind === 'template' ? `\${${code}}` : `{${code}}`;
    }
  }
  result += escape(german.slice(last));
  return kind === 'template' ? `\`${result}\`` : result;
}

/** The source with every text that `german` has; the others stay as they are. */
export function translated(source, file, compared, german) {
  const edits = textsOf(source, file, compared).texts.filter(({ text }) => german.has(text));
  const slice = (from, to) => {
    let [result, last] = ['', from];
    for (const edit of edits) {
      if (edit.start < last || edit.end > to || (edit.start === from && edit.end === to && edit === slice.current)) continue;
      const outer = slice.current;
      slice.current = edit;
      result += source.slice(last, edit.start) + replacement(edit, german.get(edit.text), slice);
      slice.current = outer;
      last = edit.end;
    }
    return result + source.slice(last, to);
  };
  return slice(0, source.length);
}
