import { mapLayers } from '../../app/map-layers.svelte';
import { page } from '../../app/page.svelte';
import { preview } from '../../app/preview.svelte';
import { registry } from '../../app/registry.svelte';
import { provide } from '../../app/services';
import { groundSources, mapPointMenu, mapSources } from './controllers';
import { maps } from './maps.svelte';
import { stage } from './stage.svelte';
import Stage from './Stage.svelte';

page.eventListeners.push((event) => {
  // While a layer is edited, a click must not open the menu with commands.
  if (mapLayers.editedLayer === null) mapPointMenu.onSceneClick(event, stage.viewId, stage.size, page.facts);
});
page.eventListeners.push((event) => {
  if (event.kind === 'scene_gizmo' && event['view'] === stage.viewId) preview.onDrag?.(event);
});
page.eventListeners.push((event) => {
  if (event.kind !== 'maps_changed') return;
  void maps.reload(page.api);
  void mapSources.refresh();
  void groundSources.refresh();
});
provide('stage', stage);
registry.addTo('stage', { order: 10, component: Stage });
registry.addPanel({ id: 'map-sources', order: 13, place: 'side', load: async () => ({ component: (await import('./SourcesPanel.svelte')).default }) });
registry.addPanel({ id: 'measure', order: 14, place: 'side', load: async () => ({ component: (await import('./MeasurePanel.svelte')).default }) });
registry.addTo('settings', { order: 60, load: async () => ({ component: (await import('./MapSection.svelte')).default }) });
registry.addWarnings(() => maps.unreadableFiles);
registry.addWarnings(() => (stage.scene.phase === 'absent' ? [`No 3D view: ${stage.scene.reason}. The page tries again; the map shows the flight.`] : []));
registry.addCloser({ order: 70, isOpen: () => mapPointMenu.mapPoint !== null, close: () => mapPointMenu.close() });
registry.addKeys([
  { order: 190, keys: 'M', description: 'Swap map and 3D', inScene: true, handlers: { m: () => stage.swap() } },
  {
    order: 195,
    keys: 'Shift F',
    description: 'What the map shows: map and ground, own sources, save for the field',
    inScene: true,
    handlers: { 'Shift F': (facts) => registry.toggle('map-sources', facts) },
  },
  { order: 200, keys: 'F', description: 'Map follows the vehicle: on or off', inScene: true, handlers: { f: () => stage.map?.toggleFollow() } },
  { order: 210, keys: 'Z', description: 'Zoom the map to the vehicle', inScene: true, handlers: { z: () => stage.map?.zoomToVehicle() } },
  {
    order: 212,
    keys: 'D',
    description: 'Measure distances and areas on the map',
    inScene: true,
    handlers: { d: (facts) => registry.toggle('measure', facts) },
  },
  { order: 215, keys: 'U', description: 'Map north up', inScene: true, handlers: { u: () => stage.map?.northUp() } },
]);
