/** What the browser loads before it shows the page: the modules that `main.ts` imports, directly or through others. */

import { describe, expect, it } from 'vitest';

const sources = import.meta.glob<string>(['../**/*.{ts,svelte}', '!../**/*.test.ts'], { query: '?raw', import: 'default', eager: true });
/** Source by path below `src/`. */
const files = new Map(Object.entries(sources).map(([path, source]) => [path.replace(/^\.\.\//, '').replace(/^\.\//, 'app/'), source]));
const STATIC_IMPORT = /^\s*(?:import|export)\s(?!type\b)(?:[^'"`;()]*?\sfrom\s*)?['"]([^'"]+)['"]/gm;

/** The imported modules: a file below `src/`, or the name of a package. */
function importsOf(path: string): string[] {
  const imported = [...(files.get(path) ?? '').matchAll(STATIC_IMPORT)].map(([, name = '']) => name);
  const features = path === 'main.ts' ? [...files.keys()].filter((name) => /^features\/[^/]+\/register\.ts$/.test(name)) : [];
  return [...features, ...imported.map((name) => (name.startsWith('.') ? fileOf(path, name) : name))];
}

function fileOf(importer: string, name: string): string {
  const folders = importer.split('/').slice(0, -1);
  for (const part of name.split('/'))
    if (part === '..') folders.pop();
    else if (part !== '.') folders.push(part);
  const path = folders.join('/');
  return [path, `${path}.ts`, `${path}.svelte.ts`].find((candidate) => files.has(candidate)) ?? path;
}

function loadedWith(first: string): Set<string> {
  const loaded = new Set([first]);
  for (const path of loaded) for (const imported of importsOf(path)) loaded.add(imported);
  return loaded;
}

describe('the first load', () => {
  const loaded = loadedWith('main.ts');

  it('has the page’s frame, the top bar and the actions', () => {
    for (const file of ['app/frame/Frame.svelte', 'app/frame/TopBar.svelte', 'features/stage/Stage.svelte', 'features/actions/ActionBar.svelte'])
      expect(loaded, file).toContain(file);
    expect(loaded.size).toBeGreaterThan(80);
  });

  it('has no map, 3D view, room, panel or library of theirs: they are loaded when they are shown', () => {
    const later = [
      ...['maplibre-gl', 'pmtiles', 'uplot', 'bits-ui'],
      ...['features/stage/views.ts', 'features/stage/map-engine.ts', 'features/plan/parts.ts', 'features/offboard/parts.ts', 'features/plan/plans.svelte.ts'],
      ...[...files.keys()].filter((file) => /(Panel|Sheet|List|Editor|Room|FlightCard)\.svelte$/.test(file) && !file.endsWith('ConfirmPanel.svelte')),
    ];
    expect(later.length).toBeGreaterThan(15);
    expect(later.filter((file) => file.startsWith('features/') && !files.has(file))).toEqual([]);
    expect(later.filter((file) => loaded.has(file))).toEqual([]);
  });
});
