import { registry } from '../../app/registry.svelte';

registry.addPanel({ id: 'palette', order: 5, place: 'over', load: async () => ({ component: (await import('./Palette.svelte')).default }) });
registry.addKeys([
  {
    order: 890,
    keys: 'Ctrl K',
    description: 'Find an action, a view, a vehicle, a plan or a parameter',
    inScene: true,
    handlers: { 'Ctrl K': (facts) => registry.toggle('palette', facts) },
  },
]);
