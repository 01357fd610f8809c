/** Finds the texts of a source file that a person reads, and replaces them by those of another language. */

import { parse } from 'svelte/compiler';
import {
  hasMachineName,
  isMachineCall,
  isMachineProperty,
  isName,
  isProse,
  isShownArgument,
  isShownAttribute,
  isShownName,
  isShownProperty,
  isWord,
  SILENT_ELEMENTS,
} from './rules.mjs';

const SCRIPT_TAG = '<script lang="ts">';
const COMPARISONS = new Set(['===', '!==', '==', '!=', '<', '>', '<=', '>=', 'in', 'instanceof']);
/** Elements that stand in a line of text, so that a sentence goes on over them. */
const INLINE = new Set(['b', 'strong', 'em', 'i', 'small', 'span', 'code', 'kbd', 'a', 'abbr', 'sub', 'sup', 'br', 'var', 'q', 'mark', 'time', 'output']);

/**
 * One text: its place in the source, its kind and its parts. A part is a string or a hole {start, end, choice}, which is kept;
 * `choice` has the two words of a hole that chooses one of them.
 * @typedef {{start: number, end: number, kind: 'string' | 'template' | 'markup' | 'attribute', text: string, holes: object[], line: number}} Text
 */

/** The syntax tree of a file, with the offset of its positions. */
function syntax(source, file) {
  if (file.endsWith('.svelte')) return { tree: parse(source, { modern: true, filename: file }), shift: 0 };
  const tree = parse(`${SCRIPT_TAG}${source}</script>`, { modern: true, filename: file });
  return { tree: tree.instance ?? tree.module, shift: SCRIPT_TAG.length };
}

const calleeName = (callee) => (callee.type === 'MemberExpression' ? (callee.property.name ?? null) : (callee.name ?? null));
const keyName = (key) => key.name ?? (typeof key.value === 'string' ? key.value : null);
const isString = (node) => node.type === 'Literal' && typeof node.value === 'string';

/** Finds texts in a tree. `compared` has every string of the project that is compared with something: none of them is taken as one word. */
class Finder {
  constructor(source, shift, compared) {
    this.source = source;
    this.shift = shift;
    this.compared = compared;
    this.texts = [];
    this.doubtful = [];
  }

  at(node) {
    return { start: node.start - this.shift, end: node.end - this.shift };
  }

  add(place, kind, text, holes = []) {
    const line = this.source.slice(0, place.start).split('\n').length;
    this.texts.push({ ...place, kind, text, holes, line });
  }

  /** A hole of a text. The words of `{many ? 'items' : 'item'}` belong to the sentence. */
  hole(node, expression, place = this.at(node)) {
    if (expression?.type === 'ConditionalExpression' && isString(expression.consequent) && isString(expression.alternate)) {
      const choice = [expression.consequent.value, expression.alternate.value];
      this.visit(expression.test, {});
      if (choice.every((word) => !/[{}?:|<>]/.test(word)) && /\p{L}/u.test(choice.join(''))) return { ...place, test: this.at(expression.test), choice };
    }
    this.visit(expression ?? node, { shown: true, inText: true });
    return place;
  }

  static written = (hole, n) => (hole.choice ? `{${n}?${hole.choice[0]}:${hole.choice[1]}}` : `{${n}}`);

  literal(node, context) {
    const { value } = node;
    if (context.machine || value.trim() === '') return;
    const shown = context.shown ? isWord(value) || isProse(value) : (isProse(value) || isName(value)) && !this.compared.has(value);
    if (shown) this.add(this.at(node), 'string', value);
    else if (isProse(value) || isName(value))
      this.doubtful.push({ ...this.at(node), value, line: this.source.slice(0, node.start - this.shift).split('\n').length });
  }

  template(node, context) {
    const raw = node.quasis.map((quasi) => quasi.value.cooked);
    const found = this.texts.length;
    const holes = node.expressions.map((expression) => this.hole(expression, expression));
    const text = raw.reduce((all, part, n) => all + Finder.written(holes[n - 1], n - 1) + part);
    const words = raw.join(' # ');
    const shown = !context.machine && (isProse(text) || (context.shown && isWord(words.replace(/\s/g, '')) && !/^[\s#]*$/.test(words)));
    if (shown) return this.add(this.at(node), 'template', text, holes);
    // Not a text: what its holes chose was for the machine, unless it is prose of its own.
    if (!context.shown) this.texts.splice(found, this.texts.length, ...this.texts.slice(found).filter((one) => isProse(one.text)));
    for (const hole of holes) if (hole.choice && context.shown) this.choices(node, hole);
  }

  choices(node, hole) {
    const expression = node.expressions.find((one) => this.at(one).start === hole.start);
    for (const branch of [expression.consequent, expression.alternate]) this.literal(branch, { shown: true, inMarkup: true });
  }

  /** Visits an expression or statement. `shown`: its value is shown to a person; `machine`: it is compared or sent. */
  visit(node, context) {
    if (node === null || typeof node !== 'object') return;
    if (Array.isArray(node)) return node.forEach((one) => this.visit(one, context));
    if (typeof node.type !== 'string' || node.type.startsWith('TS')) return this.visitType(node, context);
    const method = this[`visit${node.type}`];
    if (method) return method.call(this, node, context);
    this.children(node, {});
  }

  visitType(node, context) {
    if (['TSAsExpression', 'TSSatisfiesExpression', 'TSNonNullExpression'].includes(node.type)) this.visit(node.expression, context);
    else if (node.type === 'TSParameterProperty') this.visit(node.parameter, context);
  }

  children(node, context) {
    for (const [key, value] of Object.entries(node))
      if (key !== 'typeAnnotation' && key !== 'leadingComments' && key !== 'trailingComments' && value && typeof value === 'object') this.visit(value, context);
  }

  visitLiteral(node, context) {
    if (isString(node)) this.literal(node, context);
  }
  visitTemplateLiteral(node, context) {
    this.template(node, context);
  }
  visitTaggedTemplateExpression(node) {
    this.visit(node.quasi.expressions, {});
  }
  visitBinaryExpression(node, context) {
    const inner = COMPARISONS.has(node.operator) ? { machine: true } : context;
    this.visit(node.left, inner);
    this.visit(node.right, inner);
  }
  visitSwitchCase(node) {
    this.visit(node.consequent, {});
  }
  visitConditionalExpression(node, context) {
    this.visit(node.test, {});
    this.visit(node.consequent, context);
    this.visit(node.alternate, context);
  }
  visitLogicalExpression(node, context) {
    this.visit(node.left, node.operator === '&&' ? {} : context);
    this.visit(node.right, context);
  }
  visitArrayExpression(node, context) {
    this.visit(node.elements, context);
  }
  visitObjectExpression(node, context) {
    this.visit(node.properties, context);
  }
  visitProperty(node, context) {
    if (node.computed) this.visit(node.key, { machine: true });
    const name = keyName(node.key);
    this.visit(
      node.value,
      context.machine || isMachineProperty(name)
        ? { machine: true }
        : { shown: isShownName(name) || (name === 'name' && isString(node.value) && isName(node.value.value)) || context.table === true },
    );
  }
  visitPropertyDefinition(node) {
    this.visit(node.value, this.named(keyName(node.key)));
  }
  visitVariableDeclarator(node) {
    this.visit(node.init, this.named(node.id.name ?? null));
    if (node.id.type !== 'Identifier') this.visit(node.id, {});
  }
  named(name) {
    return isShownName(name) ? { shown: true, table: true } : {};
  }
  visitAssignmentExpression(node) {
    this.visit(node.right, this.named(calleeName(node.left)));
  }
  visitAssignmentPattern(node) {
    this.visit(node.right, this.named(node.left.name ?? null));
  }
  visitMemberExpression(node) {
    this.visit(node.object, {});
    if (node.computed) this.visit(node.property, { machine: true });
  }
  visitCallExpression(node, context) {
    this.visit(node.callee, {});
    const name = calleeName(node.callee);
    if (hasMachineName(name) && node.arguments.length > 1) return this.visit(node.arguments.slice(1), {});
    const derived = name === '$derived' || name === '$state' || name === 'freeze' || name === 'by';
    if (!isMachineCall(name) && node.arguments.some((_, n) => isShownArgument(name, n)))
      return node.arguments.forEach((one, n) => this.visit(one, isShownArgument(name, n) ? { shown: true } : {}));
    this.visit(node.arguments, isMachineCall(name) ? { machine: true } : derived ? context : name === 'join' && context.shown ? { shown: true } : {});
  }
  visitNewExpression(node, context) {
    const name = calleeName(node.callee);
    if (!isMachineCall(name) && node.arguments.some((_, n) => isShownArgument(name, n)))
      return node.arguments.forEach((one, n) => this.visit(one, isShownArgument(name, n) ? { shown: true } : {}));
    this.visit(node.arguments, isMachineCall(name) ? { machine: true } : name === 'Map' ? context : {});
  }
  visitFunctionDeclaration(node) {
    this.functionOf(node, node.id?.name ?? null);
  }
  visitFunctionExpression(node, context) {
    this.functionOf(node, null, context);
  }
  visitArrowFunctionExpression(node, context) {
    this.functionOf(node, null, context);
  }
  visitMethodDefinition(node) {
    if (node.value.body) this.functionOf(node.value, keyName(node.key)); // an abstract method has none
  }
  functionOf(node, name, context = {}) {
    const outer = this.returned;
    this.returned = isShownName(name) || context.shown ? { shown: true } : {};
    this.visit(node.params, {});
    this.visit(node.body, node.body.type === 'BlockStatement' ? {} : this.returned);
    this.returned = outer;
  }
  visitReturnStatement(node) {
    this.visit(node.argument, this.returned ?? {});
  }
  visitImportDeclaration() {}
  visitImportExpression() {}
  visitExportAllDeclaration() {}
  visitExportNamedDeclaration(node) {
    this.visit(node.declaration, {});
  }

  // Markup.
  visitRoot(node) {
    if (node.module) this.visit(node.module.content, {});
    if (node.instance) this.visit(node.instance.content, {});
    this.visit(node.fragment, {});
  }
  visitScript(node) {
    this.visit(node.content, {});
  }
  visitFragment(node, context) {
    this.runs(node.nodes, context);
  }
  visitRegularElement(node, context) {
    this.element(node, context);
  }
  visitComponent(node, context) {
    this.element(node, context);
  }
  element(node, context) {
    this.visit(node.attributes, { element: node.name });
    if (!SILENT_ELEMENTS.has(node.name)) this.visit(node.fragment, context);
    else if (node.name === 'svg') this.visit(node.fragment, {});
    else for (const child of node.fragment.nodes) if (child.type !== 'Text') this.children(child, {});
  }
  visitTitleElement(node, context) {
    this.visit(node.fragment, context);
  }
  visitText() {}
  visitExpressionTag(node) {
    this.visit(node.expression, { shown: true, inMarkup: true, inText: true });
  }
  visitAttribute(node) {
    const shown = isShownAttribute(node.name);
    if (node.value === true) return;
    const values = Array.isArray(node.value) ? node.value : [node.value];
    const machine = /^(class|style|id|for|role|type|href|src|d|viewBox|transform|key|icon|kind|data-.*|on.*)$/.test(node.name) && !/^on/.test(node.name);
    if (values.every((part) => part.type === 'ExpressionTag'))
      return values.forEach((part) => this.visit(part.expression, machine ? { machine } : shown ? { shown, inMarkup: true } : {}));
    if (shown && !machine) this.mixed(values, 'attribute');
    else for (const part of values) if (part.type === 'ExpressionTag') this.visit(part.expression, machine ? { machine } : {});
  }

  /** Texts that stand side by side are one sentence, with the expressions and inline elements between them. */
  runs(nodes, context) {
    let run = [];
    const close = () => {
      this.mixed(run, 'markup', context);
      run = [];
    };
    for (const node of nodes) {
      const inline =
        ['Text', 'ExpressionTag', 'IfBlock', 'EachBlock', 'RenderTag'].includes(node.type) ||
        ((node.type === 'RegularElement' || node.type === 'SvelteElement') && INLINE.has(node.name));
      if (inline) run.push(node);
      else {
        if (node.type !== 'Comment') close();
        this.visit(node, context);
      }
    }
    close();
  }

  mixed(run, kind, context = {}) {
    const hasText = (node) => node.type === 'Text' && /\p{L}/u.test(node.data);
    let [first, last] = [0, run.length - 1];
    const bare = (node) => (node.type === 'Text' ? node.data.trim() === '' : !(node.type === 'ExpressionTag'));
    while (first <= last && bare(run[first])) first += 1;
    while (last >= first && bare(run[last])) last -= 1;
    const inner = run.slice(first, last + 1);
    if (!inner.some(hasText)) return run.forEach((node) => this.visit(node, context));
    [...run.slice(0, first), ...run.slice(last + 1)].forEach((node) => this.visit(node, context));
    const holes = [];
    const text = inner.map((node) => this.mixedPart(node, holes, context)).join('');
    const place = { start: this.at(inner[0]).start, end: this.at(inner.at(-1)).end };
    const [lead, tail] = [/^\s*/.exec(text)[0].length, /\s*$/.exec(text)[0].length];
    const source = this.source.slice(place.start, place.end);
    if (lead > 0) place.start += /^\s*/.exec(source)[0].length;
    if (tail > 0) place.end -= /\s*$/.exec(source)[0].length;
    const plain = kind === 'markup' ? text.replace(/\s+/g, ' ').trim() : text.trim();
    if (/\p{L}\p{Ll}/u.test(plain.replace(/\{\d+(\?[^{}]*)?\}|<\/?\d+\/?>/g, ''))) this.add(place, kind, plain, holes);
  }

  mixedPart(node, holes, context) {
    if (node.type === 'Text') return node.data.replace(/\s+/g, ' ');
    const n = holes.length;
    if (node.type === 'ExpressionTag') {
      holes.push(this.hole(node, node.expression));
      return Finder.written(holes[n], n);
    }
    if (
      node.type === 'RegularElement' &&
      !SILENT_ELEMENTS.has(node.name) &&
      node.fragment.nodes.some((child) => child.type === 'Text' && child.data.trim() !== '') &&
      node.fragment.nodes.every((child) => ['Text', 'ExpressionTag'].includes(child.type) || (child.type === 'RegularElement' && INLINE.has(child.name)))
    ) {
      this.visit(node.attributes, { element: node.name });
      const { start, end } = this.at(node);
      const inside = [this.at(node.fragment.nodes[0]).start, this.at(node.fragment.nodes.at(-1)).end];
      holes.push({ start, end: inside[0], close: { start: inside[1], end } });
      return `<${n}>${node.fragment.nodes.map((child) => this.mixedPart(child, holes, context)).join('')}</${n}>`;
    }
    this.visit(node, context);
    holes.push(this.at(node));
    return `{${n}}`;
  }
}

/** A comparison such as `row.label === 'Hold'` would fail in another language. */
function refuseShown({ left, right }, file) {
  for (const [one, other] of [
    [left, right],
    [right, left],
  ])
    if (one.type === 'MemberExpression' && isShownProperty(one.property.name) && isString(other) && /\p{L}\p{L}/u.test(other.value))
      throw new Error(`${file} compares the shown text “${other.value}”: compare an id.`);
}

/** Every string of a file that is compared, a key or a type: they are names, also if they look like words. */
export function comparedIn(source, file) {
  const found = new Set();
  const note = (node) => node && (isString(node) ? found.add(node.value) : Array.isArray(node) && node.forEach(note));
  const walk = (node) => {
    if (node === null || typeof node !== 'object') return;
    if (Array.isArray(node)) return node.forEach(walk);
    if (node.type === 'BinaryExpression' && COMPARISONS.has(node.operator)) note([node.left, node.right]);
    if (node.type === 'BinaryExpression' && COMPARISONS.has(node.operator)) refuseShown(node, file);
    if (node.type === 'SwitchCase') note(node.test);
    if (node.type === 'TSLiteralType') note(node.literal);
    if (node.type === 'Property' && !node.computed && keyName(node.key)) found.add(keyName(node.key));
    if (node.type === 'MemberExpression' && node.computed) note(node.property);
    if ((node.type === 'CallExpression' || node.type === 'NewExpression') && isMachineCall(calleeName(node.callee))) {
      note(node.arguments);
      for (const argument of node.arguments) if (argument.type === 'ArrayExpression') note(argument.elements.filter(Boolean));
    }
    if (
      node.type === 'CallExpression' &&
      node.callee.type === 'MemberExpression' &&
      node.callee.object.type === 'ArrayExpression' &&
      isMachineCall(calleeName(node.callee))
    )
      note(node.callee.object.elements.filter(Boolean));
    if (node.type === 'TSIndexedAccessType') return walk(node.objectType);
    for (const value of Object.values(node)) if (value && typeof value === 'object') walk(value);
  };
  walk(syntax(source, file).tree);
  return found;
}

/** The texts of a file, in the order of their places. */
export function textsOf(source, file, compared) {
  const { tree, shift } = syntax(source, file);
  const finder = new Finder(source, shift, compared);
  finder.visit(tree, {});
  return { texts: finder.texts.sort((a, b) => a.start - b.start || b.end - a.end), doubtful: finder.doubtful };
}
