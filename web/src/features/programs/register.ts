import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import { programs } from './controllers';

programs.poll(page.api);
registry.addTo('cards', {
  order: 35,
  load: async () => ({ vehicleComponent: (await import('./ProgramsCard.svelte')).default }),
  applies: () => page.facts !== null && !page.facts.replayed && programs.of(page.facts.id).length > 0,
});
