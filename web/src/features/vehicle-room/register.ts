import { docks, registry, rooms } from '../../app/registry.svelte';

const ROOM = 'vehicle';

registry.addRoom({
  id: ROOM,
  title: 'Vehicle',
  icon: 'wrench',
  hint: 'Set-up of the vehicle (Shift V)',
  order: 15,
  layout: (width_px) => ({ left_px: width_px < 1280 ? docks(width_px).left_px : width_px < 1360 ? 390 : 470, bottom_px: 0, top_px: 0 }),
  load: async () => (await import('./parts')).parts,
});
registry.addKeys([{ order: 142, keys: 'Shift V', description: 'Vehicle view: set-up', inScene: true, handlers: { 'Shift V': () => rooms.toggle(ROOM) } }]);
