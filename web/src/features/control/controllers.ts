/** The one desk of this page where control is taken, asked for, given and released. */

import { page } from '../../app/page.svelte';
import { actions } from '../../app/session.svelte';
import { ControlDesk } from './control.svelte';

export const control = new ControlDesk(page.api, actions);
