/** The flights for the search: choosing one opens it. */

import type { Findable } from '../../app/registry.svelte';
import { library, openRow } from './controllers';
import { detailsOf, titleOf } from './library.svelte';

export async function findableFlights(): Promise<readonly Findable[]> {
  await library.load();
  return library.rows.map((row) => ({ title: titleOf(row), hint: `Open the flight: ${detailsOf(row)}`, run: () => openRow(row) }));
}
