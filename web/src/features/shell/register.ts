import { registry } from '../../app/registry.svelte';

registry.addPanel({
  id: 'shell',
  order: 32,
  place: 'side',
  load: async () => ({ vehicleComponent: (await import('./ShellPanel.svelte')).default }),
  needs: 'shell',
  rail: { title: 'Console', icon: 'terminal', hint: 'The vehicle’s console, PX4’s shell (S)' },
});
registry.addKeys([
  {
    order: 163,
    keys: 'S',
    description: 'Console of the vehicle (PX4’s shell)',
    inScene: true,
    handlers: { s: (facts) => registry.toggle('shell', facts) },
  },
]);
