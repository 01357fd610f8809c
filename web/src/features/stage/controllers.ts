/** The controllers of the stage; the page has one instance of each. */

import { page } from '../../app/page.svelte';
import { actions, nowS } from '../../app/vehicle-actions.svelte';
import { MapPointMenu } from './map-point.svelte';
import { MapSources } from './map-sources.svelte';
import { Measurement } from './measure.svelte';

export const mapPointMenu = new MapPointMenu(page.api, actions, nowS);
export const mapSources = new MapSources(page.api);
export const measurement = new Measurement();
