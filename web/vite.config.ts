import { svelte } from '@sveltejs/vite-plugin-svelte';
import type { ManualChunksOption } from 'rollup';
import { defineConfig } from 'vitest/config';
import { FONT, smallFont } from './dev/font.mjs';
import { pageTexts } from './dev/texts/plugin.mjs';

declare const process: { env: Record<string, string | undefined> };

/** The server that `npm run dev` uses: the real server, or `npm run dev:fake`. */
const server = process.env['GCS_URL'] ?? 'http://127.0.0.1:8080';

/** All that the page needs before it is shown in one file: sixty small files are a seventh larger when compressed. */
function firstLoad(): ManualChunksOption {
  let modules: Set<string> | null = null;
  return (id, { getModuleIds, getModuleInfo }) => {
    modules ??= new Set([...getModuleIds()].filter((each) => getModuleInfo(each)?.isEntry));
    for (const each of modules) for (const imported of getModuleInfo(each)?.importedIds ?? []) modules.add(imported);
    return modules.has(id) ? 'index' : undefined;
  };
}

/** `vite build --mode de` builds the German page beside the English one. */
export default defineConfig(async ({ mode }) => ({
  plugins: [pageTexts(mode === 'de' ? 'de' : 'en'), svelte()],
  resolve: { alias: { [FONT]: await smallFont() } },
  build: {
    outDir: '../gcs_server/static',
    emptyOutDir: true,
    target: 'es2022',
    assetsInlineLimit: 0, // no data: addresses, so that a strict CSP needs no exception
    modulePreload: { polyfill: false },
    rollupOptions: { output: { manualChunks: firstLoad() } },
  },
  server: {
    host: '127.0.0.1',
    proxy: {
      '/api': { target: server, ws: true },
      '/scene': { target: server, ws: true },
    },
  },
  // A context for each file in one process: half the time of a process for each.
  test: { include: ['src/**/*.test.ts'], environment: 'node', pool: 'vmThreads' },
}));
