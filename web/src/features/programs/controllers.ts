/** The page's only `Programs` and `Agents` instances. */

import { Agents } from './agents.svelte';
import { Programs } from './programs.svelte';

export const programs = new Programs();
export const agents = new Agents();
