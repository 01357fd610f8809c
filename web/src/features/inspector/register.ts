import { registry } from '../../app/registry.svelte';

registry.addPanel({
  id: 'inspector',
  order: 34,
  place: 'side',
  load: async () => ({ vehicleComponent: (await import('./InspectorPanel.svelte')).default }),
  protocol: 'MAVLink',
  rail: { title: 'MAVLink', icon: 'pulse', hint: 'MAVLink messages: rates, fields, plots; send a message (Shift X)' },
});
registry.addKeys([
  {
    order: 164,
    keys: 'Shift X',
    description: 'MAVLink inspector: every message, its fields and plots',
    inScene: true,
    handlers: { 'Shift X': (facts) => registry.toggle('inspector', facts) },
  },
]);
