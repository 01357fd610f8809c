import { page } from '../../app/page.svelte';
import { docks, registry, rooms } from '../../app/registry.svelte';
import { FOLDED_PX, profileFold } from './profile/fold.svelte';

const ROOM = 'plan';

registry.addRoom({
  id: ROOM,
  title: 'Plan',
  icon: 'plan',
  hint: 'Plans (W)',
  order: 5,
  withoutVehicle: true,
  layout: (width_px) => ({ ...docks(width_px), top_px: 56, ...(profileFold.isFolded ? { bottom_px: FOLDED_PX } : {}) }),
  foldsInstruments: true,
  load: async () => (await import('./parts')).parts,
});
/** Whether the selected vehicle has reported a flight on this topic. */
const hasFlight = (topic: string): boolean => page.eachRepaint(() => page.vehicle?.newestSample(topic) != null);
const reportedMission = (): { count: number | null } | undefined => page.vehicle?.newestSample('mission')?.value as { count: number | null } | undefined;
const hasMission = (): boolean => page.eachRepaint(() => (reportedMission()?.count ?? 0) > 0);
/** Whether the vehicle holds in the air and has a mission that it can begin or resume. */
const canBegin = (): boolean => page.facts?.inAir === true && page.facts.status?.value.mode === 'hold' && hasMission();
const isInMission = (): boolean => page.facts?.status?.value.mode === 'mission';
registry.addTo('cards', {
  order: 25,
  load: async () => ({ vehicleComponent: (await import('./flight/FlightCard.svelte')).default }),
  applies: () => isInMission() || canBegin() || hasFlight('waypoint_flight'),
});
registry.addTo('cards', {
  order: 26,
  load: async () => ({ vehicleComponent: (await import('./flight/OffboardFlightCard.svelte')).default }),
  applies: () => hasFlight('offboard_mission'),
});
registry.addTo('stage', { order: 30, load: async () => ({ component: (await import('./flight/MissionOnMap.svelte')).default }), applies: hasMission });
registry.addKeys([
  { order: 138, keys: 'W', description: 'Plan view: waypoint plans and offboard missions', inScene: false, handlers: { w: () => rooms.toggle(ROOM) } },
  { order: 139, keys: 'Ctrl C V D', description: 'Plan view: copy, paste, duplicate the selected items', inScene: false },
  { order: 140, keys: 'Ctrl V', description: 'Plan view: place an item at copied coordinates such as 47.39, 8.54', inScene: false },
]);
registry.addFinder({ group: 'Plans', order: 50, load: async () => (await import('./find')).findablePlans });
