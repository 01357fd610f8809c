/** The one menu of this page for a point on the map or in 3D. */

import { page } from '../../app/page.svelte';
import { actions, nowS } from '../../app/session.svelte';
import { SpotMenu } from './spot.svelte';

export const spotMenu = new SpotMenu(page.api, actions, nowS);
