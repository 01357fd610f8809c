import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import VehicleBar from './VehicleBar.svelte';

function selectByDigit(digit: number): boolean {
  const id = page.ids[(digit + 9) % 10];
  if (id !== undefined) page.select(id);
  return id !== undefined;
}

registry.addPanel({
  id: 'vehicles',
  order: 15,
  place: 'side',
  load: async () => ({ component: (await import('./VehiclePanel.svelte')).default }),
});
registry.addTo('vehicles', { order: 10, component: VehicleBar });
registry.addKeys([
  {
    order: 218,
    keys: 'J',
    description: 'Vehicle list: find, select, switch all flying vehicles to Hold',
    inScene: true,
    handlers: { j: (facts) => registry.toggle('vehicles', facts) },
  },
  {
    order: 220,
    keys: '1 … 9',
    description: 'Select a vehicle (0: the tenth)',
    inScene: true,
    handlers: Object.fromEntries(Array.from({ length: 10 }, (_, digit) => [String(digit), () => selectByDigit(digit)])),
  },
]);
registry.addFinder({
  group: 'Vehicles',
  order: 40,
  load: async () => () => page.ids.map((id) => ({ title: page.factsOf(id)?.name ?? `Vehicle ${id}`, hint: 'Select the vehicle', run: () => page.select(id) })),
});
