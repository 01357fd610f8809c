import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import VehicleBar from './VehicleBar.svelte';

function choose(digit: number): boolean {
  const id = page.ids[(digit + 9) % 10];
  if (id !== undefined) page.select(id);
  return id !== undefined;
}

registry.addTo('vehicles', { order: 10, component: VehicleBar });
registry.addKeys([
  {
    order: 220, keys: '1 … 9', what: 'Choose a vehicle; 0 is the tenth', inScene: true,
    on: Object.fromEntries(Array.from({ length: 10 }, (_, digit) => [String(digit), () => choose(digit)])),
  },
]);
