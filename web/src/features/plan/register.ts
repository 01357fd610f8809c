import { page } from '../../app/page.svelte';
import { docks, registry, rooms } from '../../app/registry.svelte';

const ROOM = 'plan';

registry.addRoom({
  id: ROOM,
  title: 'Plan',
  icon: 'plan',
  hint: 'Plans (W)',
  order: 5,
  withoutVehicle: true,
  layout: (width_px) => ({ ...docks(width_px), top_px: 56 }),
  load: async () => (await import('./parts')).parts,
});
/** Whether the selected vehicle has reported a flight on this topic. */
const hasFlight = (topic: string): boolean => page.eachRepaint(() => page.vehicle?.newestSample(topic) != null);
const isInMission = (): boolean => page.facts?.status?.value.mode === 'mission';
registry.addTo('cards', {
  order: 25,
  load: async () => ({ vehicleComponent: (await import('./flight/FlightCard.svelte')).default }),
  applies: () => isInMission() || hasFlight('waypoint_flight'),
});
registry.addTo('cards', {
  order: 26,
  load: async () => ({ vehicleComponent: (await import('./flight/OffboardFlightCard.svelte')).default }),
  applies: () => hasFlight('offboard_mission'),
});
registry.addKeys([
  { order: 138, keys: 'W', description: 'Plan view: waypoint plans and offboard missions', inScene: false, handlers: { w: () => rooms.toggle(ROOM) } },
]);
