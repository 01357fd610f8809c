import type { Plugin } from 'vite';

export function pageTexts(language: 'en' | 'de'): Plugin;
