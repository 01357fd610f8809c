import { registry } from '../../app/registry.svelte';

registry.addPanel({
  id: 'simulator',
  order: 14,
  place: 'side',
  load: async () => ({ component: (await import('./SimulatorPanel.svelte')).default }),
});
registry.addKeys([
  {
    order: 219,
    keys: 'Shift J',
    description: 'Simulator: where PX4 comes from, state and console of each instance',
    inScene: true,
    handlers: { 'Shift J': (facts) => registry.toggle('simulator', facts) },
  },
]);
