import { mapLayers } from '../../app/map-layers.svelte';
import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import { provide } from '../../app/services';
import { guided } from './controllers';
import { flownCircle } from './guided';

provide('guided', {
  open: (kind, facts, place) => {
    guided.open(kind, facts, place);
    if (!registry.isOpen('guided')) registry.toggle('guided', facts);
  },
});
mapLayers.show({
  id: 'device',
  content: () => (page.facts === null ? null : (guided.device?.content(registry.isOpen('guided') ? guided.draft : null, page.facts) ?? null)),
});
page.setpointListeners.push((id) => guided.device?.end(id));
page.neededVehicles.push(() => guided.device?.vehicles() ?? []);
mapLayers.show({ id: 'orbit', content: () => (page.facts === null ? null : flownCircle(page.facts)) });
const preview = () => (registry.isOpen('guided') ? guided.preview(page.facts) : null);
mapLayers.show({ id: 'guided', content: () => (guided.usesPlace ? null : preview()) });
mapLayers.show({ id: 'guided place', content: () => (guided.usesPlace ? preview() : null), editor: guided.editor });
registry.addPanel({
  id: 'guided',
  order: 16,
  place: 'side',
  load: async () => ({ vehicleComponent: (await import('./GuidedPanel.svelte')).default }),
});
registry.addKeys([
  {
    order: 45,
    keys: 'B',
    description: 'Guide: altitude, heading, speed, orbit, follow, home',
    inScene: true,
    handlers: { b: (facts) => facts !== null && registry.toggle('guided', facts) },
  },
]);
