import { registry } from '../../app/registry.svelte';
import { valueChoice } from './choice.svelte';
import Instrument from './Instrument.svelte';
import ValueGrid from './ValueGrid.svelte';

registry.addTo('cards', { order: 10, vehicleComponent: Instrument, inEveryRoom: true });
registry.addTo('cards', { order: 20, vehicleComponent: ValueGrid });
registry.addCloser({ order: 60, isOpen: () => valueChoice.editing, close: () => (valueChoice.editing = false) });
registry.addKeys([
  { order: 180, keys: 'V', description: 'Choose the values shown', inScene: true, handlers: { v: () => void (valueChoice.editing = !valueChoice.editing) } },
]);
