import { registry } from '../../app/registry.svelte';

registry.addPanel({
  id: 'params',
  order: 30,
  place: 'side',
  load: async () => ({ vehicleComponent: (await import('./ParamPanel.svelte')).default }),
  needs: 'parameters',
  rail: { title: 'Params', icon: 'sliders', hint: 'Parameters (I)' },
});
registry.addKeys([
  { order: 160, keys: 'I', description: 'Parameters: search, read, set', inScene: true, handlers: { i: (facts) => registry.toggle('params', facts) } },
]);
registry.addFinder({ group: 'Parameters', order: 60, load: async () => (await import('./find')).findableParameters });
