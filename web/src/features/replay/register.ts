import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import { replay } from './controllers';
import FlightsButton from './FlightsButton.svelte';

page.telemetryListeners.push(() => replay.onTelemetry());
registry.addPanel({
  id: 'recordings',
  order: 40,
  place: 'over',
  load: async () => ({ component: (await import('./RecordingList.svelte')).default }),
});
registry.addTo('bottom', {
  order: 10,
  load: async () => ({ component: (await import('./ReplayBar.svelte')).default }),
  applies: () => replay.shownReplay !== null,
});
registry.addTo('indicators', { order: 40, component: FlightsButton });
registry.addKeys([
  { order: 240, keys: 'Space', description: 'Replay: play or pause', inScene: false },
  { order: 250, keys: '← →', description: 'Replay: 5 s back or forward, 30 s with Shift', inScene: false },
]);
