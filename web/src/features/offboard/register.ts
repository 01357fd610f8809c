import { page } from '../../app/page.svelte';
import { docks, registry, rooms } from '../../app/registry.svelte';
import { provide } from '../../app/services';
import { actions } from '../../app/vehicle-actions.svelte';
import { groups, offboard } from './controllers';
import OffboardCard from './OffboardCard.svelte';
import { ROOM_ID } from './room.svelte';

provide('offboard', { start: (facts, streamStart) => offboard.start(facts, streamStart) });
page.neededVehicles.push(() => offboard.renewedVehicles());
page.neededVehicles.push(() => groups.activeGroups.flatMap(({ group }) => (groups.isOwn(group) ? group.members.map((member) => member.vehicle) : [])));
page.telemetryListeners.push(() => offboard.onTelemetry((id) => page.isStreaming(id)));
page.telemetryListeners.push(() => groups.onTelemetry(page.connection));
page.eventListeners.push((event) => groups.handleEvent(event));

registry.addRoom({
  id: ROOM_ID,
  title: 'Offboard',
  icon: 'pulse',
  hint: 'Setpoints, plots, gamepad (P)',
  order: 10,
  layout: docks,
  load: async () => (await import('./parts')).parts,
});
registry.addTo('cards', { order: 30, vehicleComponent: OffboardCard });
registry.addKeys([
  {
    order: 130,
    keys: 'O',
    description: 'Start offboard at the current position',
    inScene: true,
    handlers: { o: (facts) => actions.request('offboard_start', facts, 'offboard') },
  },
  { order: 140, keys: 'P', description: 'Offboard view: setpoints, plots, gamepad', inScene: true, handlers: { p: () => rooms.toggle(ROOM_ID) } },
]);
