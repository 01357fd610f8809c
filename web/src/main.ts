import { mount } from 'svelte';
import './ui/tokens.css';
import './ui/base.css';
import './ui/fields.css';
import './ui/panels.css';
import Frame from './app/frame/Frame.svelte';
import { page } from './app/page.svelte';

// Each folder in features/ has a register.ts that registers the feature's parts; only this file imports all of them.
import.meta.glob('./features/*/register.ts', { eager: true });

const target = document.getElementById('app');
if (target === null) throw new Error('The page has no element #app.');
mount(Frame, { target });
page.start();
