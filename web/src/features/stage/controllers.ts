/** The controllers of the stage; the page has one instance of each. */

import { page } from '../../app/page.svelte';
import { actions, nowS } from '../../app/vehicle-actions.svelte';
import { MapPointMenu } from './map-point.svelte';

export const mapPointMenu = new MapPointMenu(page.api, actions, nowS);
