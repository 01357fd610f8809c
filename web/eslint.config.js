/** Rules: which layer of the page may import which layer, and common mistakes of TypeScript and Svelte. */

import boundaries from 'eslint-plugin-boundaries';
import svelte from 'eslint-plugin-svelte';
import ts from 'typescript-eslint';

/** Each layer's folder in src/ and the layers it may import. */
const LAYERS = {
  ui: [],
  api: [],
  live: ['api'],
  vehicle: ['ui', 'api', 'live'],
  app: ['ui', 'api', 'live', 'vehicle'],
  plots: ['ui', 'api', 'live', 'vehicle', 'app'],
  feature: ['ui', 'api', 'live', 'vehicle', 'app', 'plots'],
};

/** The files that each layer may import from itself: all files; a feature: only the files of the same feature. */
const ownFiles = (layer) => (layer === 'feature' ? { type: layer, captured: { name: '{{from.element.captured.name}}' } } : { type: layer });

export default ts.config(
  { ignores: ['node_modules', 'src/api/schema.d.ts', 'src/api/fields.ts', 'src/api/bounds.ts', 'dev'] },
  ts.configs.base,
  ...svelte.configs['flat/base'],
  { files: ['**/*.svelte', '**/*.svelte.ts'], languageOptions: { parserOptions: { parser: ts.parser } } },
  {
    files: ['src/**/*.{ts,svelte}'],
    rules: {
      eqeqeq: ['error', 'always', { null: 'ignore' }],
      'no-var': 'error',
      'no-console': 'error',
      'no-eval': 'error',
      'no-implied-eval': 'error',
      '@typescript-eslint/no-explicit-any': 'error',
      '@typescript-eslint/no-non-null-assertion': 'error',
      '@typescript-eslint/ban-ts-comment': 'error',
      'svelte/no-at-html-tags': 'error',
      'svelte/no-at-debug-tags': 'error',
      'svelte/no-dupe-else-if-blocks': 'error',
      'svelte/no-unused-svelte-ignore': 'error',
      'svelte/require-each-key': 'error',
    },
  },
  {
    // main.ts imports every layer; a test may import several features.
    files: ['src/**/*.{ts,svelte}'],
    ignores: ['src/**/*.test.ts', 'src/main.ts'],
    plugins: { boundaries },
    settings: {
      'import/resolver': { typescript: { project: './tsconfig.json' } },
      'boundaries/elements': [
        ...['ui', 'api', 'live', 'vehicle', 'app', 'plots'].map((type) => ({ type, pattern: `src/${type}` })),
        { type: 'feature', pattern: 'src/features/*', capture: ['name'] },
      ],
    },
    rules: {
      'boundaries/no-unknown-files': 'error',
      'boundaries/dependencies': [
        'error',
        {
          default: 'disallow',
          message: '{{from.element.type}} may not import {{to.element.type}}: features use each other only through app/registry.svelte.ts and app/services.ts.',
          policies: Object.entries(LAYERS).map(([from, layers]) => ({
            from: { element: { type: from } },
            allow: [ownFiles(from), ...layers.map((type) => ({ type }))].map((element) => ({ to: { element } })),
          })),
        },
      ],
    },
  },
);
