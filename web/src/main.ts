import { mount } from 'svelte';
import './ui/tokens.css';
import './ui/base.css';
import './ui/fields.css';
import './ui/panels.css';
import { useServerTexts } from './api/server-text';
import Frame from './app/frame/Frame.svelte';
import { readLanguage } from './app/language';
import { page } from './app/page.svelte';

// Each folder in features/ has a register.ts that registers the feature's parts; only this file imports all of them.
import.meta.glob('./features/*/register.ts', { eager: true });

const target = document.getElementById('app');
if (target === null) throw new Error('The page has no element #app.');
if (readLanguage() !== 'en') useServerTexts((await import('virtual:server-texts')).default);
mount(Frame, { target });
page.start();
