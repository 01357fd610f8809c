/** The server's links, asked for every few seconds: they change rarely and are no telemetry. */

import type { ApiClient } from '../../api/client';
import { readLinks, type LinkLine } from './links';

const EVERY_MS = 3000;

export const links = $state<{ list: LinkLine[]; known: boolean }>({ list: [], known: false });

export function pollLinks(api: ApiClient): void {
  const ask = async (): Promise<void> => {
    const answer = await api.get<unknown>('/links');
    links.known = answer.ok;
    links.list = answer.ok ? readLinks(answer.value) : [];
    setTimeout(() => void ask(), EVERY_MS);
  };
  void ask();
}
