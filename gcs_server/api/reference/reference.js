// Renders the server's own OpenAPI description; everything comes from this server, nothing from elsewhere.

const METHODS = ['get', 'post', 'put', 'patch', 'delete'];
const DEEPEST = 6;

function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children.filter((child) => child !== null));
  return made;
}

function resolve(api, schema) {
  const name = schema?.$ref?.split('/').pop();
  return name === undefined ? (schema ?? {}) : api.components.schemas[name];
}

function variants(schema) {
  return (schema.anyOf ?? schema.oneOf ?? []).filter((part) => part.type !== 'null');
}

/** What a value of this schema may look like: required fields, and those with an example. */
export function example(api, given, depth = 0) {
  const schema = resolve(api, given);
  if (depth > DEEPEST) return null;
  if (schema.examples?.length) return schema.examples[0];
  if (schema.example !== undefined) return schema.example;
  if (schema.const !== undefined) return schema.const;
  if (schema.default !== undefined && schema.default !== null) return schema.default;
  if (schema.enum) return schema.enum[0];
  const parts = variants(schema);
  if (parts.length) return example(api, parts[0], depth + 1);
  if (schema.allOf?.length) return example(api, schema.allOf[0], depth + 1);
  if (schema.type === 'object' || schema.properties) {
    const required = new Set(schema.required ?? []);
    const fields = Object.entries(schema.properties ?? {}).filter(([name, field]) => required.has(name) || field.const !== undefined);
    return Object.fromEntries(fields.map(([name, field]) => [name, example(api, field, depth + 1)]));
  }
  if (schema.type === 'array') {
    const items = schema.prefixItems ?? Array(schema.minItems ?? 1).fill(schema.items ?? {});
    return items.map((item) => example(api, item, depth + 1));
  }
  if (schema.type === 'number' || schema.type === 'integer') {
    const low = schema.minimum ?? schema.exclusiveMinimum ?? 0;
    return low > 0 ? Math.ceil(low) : 0;
  }
  return schema.type === 'boolean' ? false : 'string';
}

function typeWords(api, given) {
  const name = given?.$ref?.split('/').pop();
  const schema = resolve(api, given);
  const parts = [...(schema.anyOf ?? schema.oneOf ?? [])];
  if (parts.length) return parts.map((part) => typeWords(api, part)).join(' or ');
  if (schema.const !== undefined) return JSON.stringify(schema.const);
  if (schema.enum) return schema.enum.map((value) => JSON.stringify(value)).join(' | ');
  if (schema.type === 'array') return `list of ${schema.items ? typeWords(api, schema.items) : 'numbers'}`;
  const bounds = [schema.minimum, schema.maximum].some((bound) => bound !== undefined)
    ? ` (${schema.minimum ?? '…'} to ${schema.maximum ?? '…'})`
    : '';
  return `${name ?? schema.type ?? 'anything'}${bounds}`;
}

function table(rows) {
  const lines = rows.map((cells) =>
    element('tr', {}, ...cells.map((cell, place) => element('td', {}, place === 0 ? element('code', {}, cell) : cell))));
  return element('div', { className: 'scroll' }, element('table', {}, element('tbody', {}, ...lines)));
}

function fieldRows(api, given, prefix = '', depth = 0) {
  const schema = resolve(api, given);
  const parts = variants(schema);
  if (parts.length && !schema.properties) return parts.flatMap((part) => fieldRows(api, part, prefix, depth));
  const required = new Set(schema.required ?? []);
  return Object.entries(schema.properties ?? {}).flatMap(([name, field]) => {
    const own = [prefix + name, `${typeWords(api, field)}${required.has(name) ? '' : ', may be left out'}`, field.description ?? ''];
    const inner = resolve(api, field);
    const deeper = depth < 2 && (inner.properties || variants(inner).some((part) => resolve(api, part).properties));
    return deeper ? [own, ...fieldRows(api, field, `${prefix}${name}.`, depth + 1)] : [own];
  });
}

/** The call as it can be pasted into a shell; vehicle 1 is what `make run` starts. */
export function curl(api, method, path, operation) {
  const samples = { v: '1', name: path.includes('/params/') ? 'MPC_XY_VEL_MAX' : 'LINK' };
  const url = location.origin + path.replace(/\{(\w+)\}/g, (_, name) => samples[name] ?? name);
  const body = operation.requestBody?.content?.['application/json']?.schema;
  const verb = method === 'get' ? '' : ` -X ${method.toUpperCase()}`;
  const data = body === undefined ? '' : ` \\\n  -H 'Content-Type: application/json' -d '${JSON.stringify(example(api, body))}'`;
  return `curl -sS${verb} ${url}${data}`;
}

function showOperation(api, method, path, operation) {
  const body = operation.requestBody?.content?.['application/json']?.schema;
  const answer = Object.entries(operation.responses).find(([status]) => status.startsWith('2'));
  const answerSchema = answer?.[1].content?.['application/json']?.schema;
  const parameters = (operation.parameters ?? []).map((p) => [p.name, `${p.in}, ${typeWords(api, p.schema)}`, p.description ?? '']);
  const problems = Object.entries(operation.responses).filter(([status]) => !status.startsWith('2'));
  const part = (title, content) => (content === null ? [] : [element('h3', {}, title), content]);
  return element('details', {},
    element('summary', {},
      element('span', { className: 'method' }, method.toUpperCase()),
      element('code', {}, path),
      element('span', { className: 'quiet' }, (operation.description ?? '').split('\n')[0])),
    element('div', {},
      ...(operation.description ?? '').split('\n\n').map((text) => element('p', {}, text)),
      element('pre', {}, curl(api, method, path, operation)),
      ...part('Parameters', parameters.length ? table(parameters) : null),
      ...part('Body', body === undefined ? null : table(fieldRows(api, body))),
      ...part(`Answer${answer ? ` (${answer[0]})` : ''}`, answerSchema === undefined ? null : table(fieldRows(api, answerSchema.items ?? answerSchema))),
      ...part('Problems', problems.length ? table(problems.map(([status, p]) => [status, (p.$ref ? api.components.responses[p.$ref.split('/').pop()] : p).description])) : null)));
}

async function show() {
  const about = document.getElementById('about');
  const answer = await fetch('/api/v1/openapi.json');
  if (!answer.ok) {
    about.textContent = `The server answered ${answer.status} instead of its description; is it starting? Reload the page.`;
    return;
  }
  const api = await answer.json();
  about.textContent = api.info.description;
  const byTag = new Map();
  for (const [path, methods] of Object.entries(api.paths)) {
    for (const method of METHODS.filter((name) => name in methods)) {
      const operation = methods[method];
      const tag = operation.tags?.at(-1) ?? 'other';
      byTag.set(tag, [...(byTag.get(tag) ?? []), showOperation(api, method, path, operation)]);
    }
  }
  const main = document.getElementById('operations');
  const tags = new Set([...(api.tags ?? []).map(({ name }) => name), ...byTag.keys()]);
  for (const tag of tags) main.append(element('section', {}, element('h2', {}, tag), ...(byTag.get(tag) ?? [])));
  document.getElementById('find').addEventListener('input', (event) => {
    const wanted = event.target.value.trim().toLowerCase();
    for (const section of main.children) {
      const all = [...section.querySelectorAll(':scope > details')];
      for (const one of all) one.hidden = !one.firstChild.textContent.toLowerCase().includes(wanted);
      section.hidden = all.every((one) => one.hidden);
    }
  });
}

show().catch((error) => {
  document.getElementById('about').textContent = `The description could not be shown: ${error.message}. Is the server running?`;
});
