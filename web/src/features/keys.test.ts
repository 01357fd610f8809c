/** The keyboard shortcuts that all features register. */

import { expect, it, vi } from 'vitest';
import { stubBrowser } from '../app/page.fixture';

stubBrowser();
vi.stubGlobal('matchMedia', () => ({ matches: false, addEventListener: () => undefined }));
const { registry } = await import('../app/registry.svelte');
await import('../app/keys');
for (const load of Object.values(import.meta.glob('./*/register.ts'))) await load();

it('has one handler for each key', () => {
  const keys = registry.keys.flatMap(({ handlers }) => Object.keys(handlers ?? {}));
  expect(keys.length).toBeGreaterThan(30);
  expect(keys.filter((key, index) => keys.indexOf(key) !== index)).toEqual([]);
});
