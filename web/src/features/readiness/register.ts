import { registry } from '../../app/registry.svelte';

registry.addPanel({
  id: 'readiness',
  order: 20,
  place: 'side',
  load: async () => ({ vehicleComponent: (await import('./ReadinessPanel.svelte')).default }),
  needs: 'arming_report',
  explains: { code: 'rejected', text: 'Show what blocks each mode' },
});
registry.addKeys([
  {
    order: 150,
    keys: 'Y',
    description: 'Readiness: why the vehicle cannot be armed or fly in a mode',
    inScene: true,
    handlers: { y: (facts) => registry.toggle('readiness', facts) },
  },
]);
