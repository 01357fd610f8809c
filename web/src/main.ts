import { mount } from 'svelte';
import './ui/tokens.css';
import './ui/base.css';
import App from './App.svelte';
import { start } from './app/session.svelte';

const target = document.getElementById('app');
if (target === null) throw new Error('The page has no #app to live in.');
mount(App, { target });
start();
