/** The controllers of the stage; the page has one instance of each. */

import { page } from '../../app/page.svelte';
import { actions, nowS } from '../../app/vehicle-actions.svelte';
import { MapPointMenu } from './map-point.svelte';
import { Measurement } from './measure.svelte';
import { groundCalls, mapCalls } from './source-calls';
import { TileSources } from './tile-sources.svelte';

export const mapPointMenu = new MapPointMenu(page.api, actions, nowS);
export const mapSources = new TileSources(page.api, mapCalls(page.api), 'map');
export const groundSources = new TileSources(page.api, groundCalls(page.api), 'ground');
export const measurement = new Measurement();
