import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import { provide } from '../../app/services';
import { replay } from './controllers';

page.telemetryListeners.push(() => replay.onTelemetry());
provide('replay', { open: (recording) => replay.open(recording), openingName: () => replay.openingName, problem: () => replay.problem });
registry.addTo('bottom', {
  order: 10,
  load: async () => ({ component: (await import('./ReplayBar.svelte')).default }),
  applies: () => replay.shownReplay !== null,
});
registry.addKeys([
  { order: 240, keys: 'Space', description: 'Replay: play or pause', inScene: false },
  { order: 250, keys: '← →', description: 'Replay: 5 s back or forward, 30 s with Shift', inScene: false },
]);
