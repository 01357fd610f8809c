import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import { voice } from './voice.svelte';
import VoiceSwitch from './VoiceSwitch.svelte';

page.eventListeners.push((event) => voice.take(event));
registry.addTo('messages', { order: 10, component: VoiceSwitch });
registry.addKeys([
  {
    order: 171,
    keys: 'Shift S',
    description: 'Voice: say mode, battery, distance, lost connection and warnings',
    inScene: true,
    handlers: { 'Shift S': () => voice.toggle() },
  },
]);
