import { registry } from '../../app/registry.svelte';
import Messages from './Messages.svelte';
import { panel } from './panel.svelte';

registry.addTo('notices', { order: 30, component: Messages });
registry.addKeys([
  { order: 170, keys: 'N', description: 'Show all messages, or only the newest', inScene: true, handlers: { n: () => void (panel.open = !panel.open) } },
]);
