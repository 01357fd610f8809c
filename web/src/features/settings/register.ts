import { docks, registry, rooms } from '../../app/registry.svelte';

const ROOM = 'settings';

registry.addRoom({
  id: ROOM,
  title: 'Settings',
  icon: 'gear',
  hint: 'Name, units, voice, altitudes, theme (Shift U)',
  order: 60,
  withoutVehicle: true,
  layout: (width_px) => ({ left_px: width_px < 1280 ? docks(width_px).left_px : 390, bottom_px: 0, top_px: 0 }),
  load: async () => (await import('./parts')).parts,
});
registry.addSettingsPage({ id: 'general', title: 'General', order: 10, load: () => import('./GeneralPage.svelte') });
registry.addTo('settings', { order: 10, load: async () => ({ component: (await import('./PersonSection.svelte')).default }) });
registry.addTo('settings', { order: 30, load: async () => ({ component: (await import('./UnitSection.svelte')).default }) });
registry.addTo('settings', { order: 40, load: async () => ({ component: (await import('./AltitudeSection.svelte')).default }) });
registry.addTo('settings', { order: 90, load: async () => ({ component: (await import('./FileSection.svelte')).default }) });
registry.addKeys([
  {
    order: 225,
    keys: 'Shift U',
    description: 'Settings: name, units, voice, altitudes, theme',
    inScene: true,
    handlers: { 'Shift U': () => rooms.toggle(ROOM) },
  },
]);
