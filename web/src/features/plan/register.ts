import { registry, rooms } from '../../app/registry.svelte';
import FlightCard from './flight/FlightCard.svelte';
import OffboardFlightCard from './flight/OffboardFlightCard.svelte';

const ROOM = 'plan';

registry.addRoom({
  id: ROOM,
  title: 'Plan',
  icon: 'plan',
  hint: 'Plans (W)',
  order: 5,
  withoutVehicle: true,
  toolbar: true,
  load: async () => (await import('./parts')).parts,
});
registry.addTo('cards', { order: 25, vehicleComponent: FlightCard });
registry.addTo('cards', { order: 26, vehicleComponent: OffboardFlightCard });
registry.addKeys([
  { order: 138, keys: 'W', description: 'Plan view: waypoint plans and offboard missions', inScene: false, handlers: { w: () => rooms.toggle(ROOM) } },
]);
