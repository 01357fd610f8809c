/** The page's only `Programs` instance. */

import { Programs } from './programs.svelte';

export const programs = new Programs();
