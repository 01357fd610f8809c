import { registry } from '../../app/registry.svelte';
import HelpSheet from './HelpSheet.svelte';
import KeysButton from './KeysButton.svelte';
import { sheet } from './sheet.svelte';

const toggle = (): void => void (sheet.open = !sheet.open);

registry.addPanel({ id: 'help', order: 10, place: 'over', component: HelpSheet, isOpen: () => sheet.open, toggle, close: () => (sheet.open = false) });
registry.addTo('indicators', { order: 30, component: KeysButton });
registry.addKeys([{ order: 900, keys: '?', description: 'Show or hide this list', inScene: true, handlers: { '?': toggle } }]);
