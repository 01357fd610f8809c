import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import ControlChip from './ControlChip.svelte';
import ControlPrompt from './ControlPrompt.svelte';
import { control } from './controllers';

const isNotReplayed = (): boolean => page.facts !== null && !page.facts.replayed;

page.eventListeners.push((event) => control.handleEvent(event));
registry.addTo('indicators', { order: 20, vehicleComponent: ControlChip, applies: isNotReplayed });
registry.addTo('notices', { order: 20, vehicleComponent: ControlPrompt });
registry.addCloser({ order: 50, isOpen: () => control.open, close: () => (control.open = false) });
registry.addKeys([
  { order: 60, keys: 'C', description: 'Show who has control; take, request or release control', inScene: true, handlers: { c: () => control.toggle() } },
  {
    order: 70,
    keys: 'G',
    description: 'Give control to the client that requests it (Shift G: keep control)',
    inScene: false,
    handlers: { g: (facts) => control.answer(facts, true), 'Shift G': (facts) => control.answer(facts, false) },
  },
]);
