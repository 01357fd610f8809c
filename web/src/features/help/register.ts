import { registry } from '../../app/registry.svelte';
import KeysButton from './KeysButton.svelte';

registry.addPanel({ id: 'help', order: 10, place: 'over', load: async () => ({ component: (await import('./HelpSheet.svelte')).default }) });
registry.addTo('indicators', { order: 30, component: KeysButton });
registry.addKeys([
  { order: 900, keys: '?', description: 'Show or hide this list', inScene: true, handlers: { '?': (facts) => registry.toggle('help', facts) } },
]);
