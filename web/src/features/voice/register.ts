import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import { voice } from './voice.svelte';

voice.start();
page.eventListeners.push((event) => voice.take(event));
registry.addTo('settings', { order: 50, load: async () => ({ component: (await import('./VoiceSection.svelte')).default }) });
registry.addKeys([
  {
    order: 171,
    keys: 'Shift S',
    description: 'Voice: say mode, battery, distance, lost connection and warnings',
    inScene: true,
    handlers: { 'Shift S': () => voice.toggle() },
  },
]);
