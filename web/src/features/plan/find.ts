/** The stored plans for the search: choosing one opens it in the plan room. */

import { page } from '../../app/page.svelte';
import { rooms, type Findable } from '../../app/registry.svelte';
import { plans } from './controllers';

export async function findablePlans(): Promise<readonly Findable[]> {
  const outcome = await page.api.get('/plans');
  if (!outcome.ok) return [];
  return outcome.value.plans.map(({ id, name, changed_by }) => ({
    title: name,
    hint: `Open the plan; last changed by ${changed_by}`,
    run: async () => {
      rooms.open('plan');
      await plans.open(id);
    },
  }));
}
