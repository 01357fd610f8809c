/** The flights for the search: choosing one opens it. */

import { page } from '../../app/page.svelte';
import type { Findable } from '../../app/registry.svelte';
import { openFlight } from './controllers';
import { detailsOf, titleOf } from './library.svelte';

export async function findableFlights(): Promise<readonly Findable[]> {
  const outcome = await page.api.get('/flights');
  if (!outcome.ok) return [];
  return outcome.value.flights.map((flight) => ({
    title: titleOf(flight),
    hint: `Open the flight: ${detailsOf(flight)}`,
    run: () => openFlight(flight.id, titleOf(flight)),
  }));
}
