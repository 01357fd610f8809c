import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import ConnectionNotice from './ConnectionNotice.svelte';
import Indicators from './Indicators.svelte';
import { links } from './links.svelte';
import StatusPill from './StatusPill.svelte';

links.poll(page.api);
registry.addTo('status', { order: 10, component: StatusPill });
registry.addTo('indicators', { order: 10, component: Indicators });
registry.addTo('notices', { order: 10, component: ConnectionNotice });
registry.addSettingsPage({ id: 'links', title: 'Links', order: 30, load: () => import('./LinksPage.svelte') });
registry.addWarnings(() => links.notices.map((notice) => notice.text));
