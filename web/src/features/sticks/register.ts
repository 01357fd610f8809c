import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import { padSeen } from './seen.svelte';

const isFlownByStick = (): boolean => page.eachRepaint(() => (page.vehicle?.newestSample('manual_control')?.value as { by?: unknown } | undefined)?.by != null);

registry.addSettingsPage({ id: 'gamepad', title: 'Gamepad', order: 20, load: () => import('./GamepadPage.svelte') });
registry.addTo('cards', {
  order: 42,
  inEveryRoom: true,
  applies: () => padSeen.value || isFlownByStick(),
  load: async () => ({ vehicleComponent: (await import('./StickCard.svelte')).default }),
});
