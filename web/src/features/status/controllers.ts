import { page } from '../../app/page.svelte';
import { LinkList } from './link-list.svelte';
import { links } from './links.svelte';

export const linkList = new LinkList(page.api, () => links.read(page.api));
