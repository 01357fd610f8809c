import { registry } from '../../app/registry.svelte';

registry.addPanel({
  id: 'modes',
  order: 18,
  place: 'side',
  load: async () => ({ vehicleComponent: (await import('./ModePanel.svelte')).default }),
});
registry.addKeys([
  {
    order: 145,
    keys: 'Shift M',
    description: 'Modes: what each does, and why one cannot be selected',
    inScene: true,
    handlers: { 'Shift M': (facts) => facts !== null && registry.toggle('modes', facts) },
  },
]);
