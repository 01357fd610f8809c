import { innerHeight } from 'svelte/reactivity/window';
import { docks, registry, rooms } from '../../app/registry.svelte';
import { provide } from '../../app/services';
import { landedVehicles } from './landed';
import { plotsShown } from './plots-shown.svelte';

const ROOM = 'flights';
/** Part of the page's height that the plots take. The rest has the map, with the action bar. */
const PLOTS = 0.46;

registry.addRoom({
  id: ROOM,
  title: 'Flights',
  icon: 'flights',
  hint: 'Recordings and logs, and their plots (Shift E)',
  order: 20,
  withoutVehicle: true,
  foldsInstruments: true,
  layout: (width_px) => ({ left_px: docks(width_px).left_px, bottom_px: plotsShown.isOpen ? Math.round((innerHeight.current ?? 800) * PLOTS) : 0, top_px: 0 }),
  load: async () => (await import('./parts')).parts,
});
registry.addTo('notices', {
  order: 25,
  load: async () => ({ component: (await import('./LandedNotice.svelte')).default }),
  applies: () => landedVehicles().length > 0,
});
registry.addKeys([
  {
    order: 144,
    keys: 'Shift E',
    description: 'Flights view: recordings, logs and their plots',
    inScene: true,
    handlers: { 'Shift E': () => rooms.toggle(ROOM) },
  },
]);
registry.addFinder({ group: 'Flights', order: 55, load: async () => (await import('./find')).findableFlights });
provide('plots', { showLive: async (...shown) => (await import('./controllers')).openLive(...shown) });
