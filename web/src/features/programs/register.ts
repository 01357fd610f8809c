import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import { agents, programs } from './controllers';

programs.poll(page.api);
agents.poll(page.api);
registry.addTo('cards', {
  order: 35,
  load: async () => ({ vehicleComponent: (await import('./ProgramsCard.svelte')).default }),
  applies: () => page.facts !== null && !page.facts.replayed && programs.of(page.facts.id).length > 0,
});
registry.addTo('cards', {
  order: 34,
  load: async () => ({ vehicleComponent: (await import('./AgentsCard.svelte')).default }),
  applies: () => page.facts !== null && !page.facts.replayed && agents.of(page.facts.id).length > 0,
});
