import { registry } from '../../app/registry.svelte';

registry.addPanel({
  id: 'files',
  order: 36,
  place: 'side',
  load: async () => ({ vehicleComponent: (await import('./FilesPanel.svelte')).default }),
  needs: 'files',
  rail: { title: 'Files', icon: 'folder', hint: 'Files on the vehicle: list, get, put, remove (Shift B)' },
});
registry.addKeys([
  {
    order: 165,
    keys: 'Shift B',
    description: 'Files on the vehicle',
    inScene: true,
    handlers: { 'Shift B': (facts) => registry.toggle('files', facts) },
  },
]);
