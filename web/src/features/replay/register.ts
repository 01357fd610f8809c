import { page } from '../../app/page.svelte';
import { registry } from '../../app/registry.svelte';
import { replay } from './controllers';
import FlightsButton from './FlightsButton.svelte';
import RecordingList from './RecordingList.svelte';
import ReplayBar from './ReplayBar.svelte';

const close = (): void => void (replay.listOpen = false);

page.telemetryListeners.push(() => replay.onTelemetry());
registry.addPanel({
  id: 'recordings',
  order: 40,
  place: 'over',
  component: RecordingList,
  isOpen: () => replay.listOpen,
  toggle: () => (replay.listOpen ? close() : void replay.openList()),
  close,
});
registry.addTo('bottom', { order: 10, component: ReplayBar, applies: () => replay.shownReplay !== null });
registry.addTo('indicators', { order: 40, component: FlightsButton });
registry.addKeys([
  { order: 240, keys: 'Space', description: 'Replay: play or pause', inScene: false },
  { order: 250, keys: '← →', description: 'Replay: 5 s back or forward, 30 s with Shift', inScene: false },
]);
