/** The vehicle's parameters for the search: choosing one opens the panel at it. */

import { ofVehicle } from '../../api/client';
import { page } from '../../app/page.svelte';
import { registry, type Findable } from '../../app/registry.svelte';
import type { VehicleFacts } from '../../vehicle/facts';
import { paramPanel } from './controllers';
import { NO_FILTER, valueText } from './params';

/** The parameters that the server has read; none before it has read any. */
export async function findableParameters(facts: VehicleFacts | null): Promise<readonly Findable[]> {
  if (facts === null || !registry.offers('params', facts)) return [];
  const outcome = await page.api.get('/vehicles/{v}/params', ofVehicle(facts.id));
  if (!outcome.ok) return [];
  return outcome.value.params.map((parameter) => ({
    title: parameter.name,
    hint: [valueText(parameter), parameter.facts?.title].filter(Boolean).join(' · '),
    run: () => {
      paramPanel.filter = { ...NO_FILTER, text: parameter.name };
      if (!registry.isOpen('params')) registry.toggle('params', facts);
    },
  }));
}
