import { registry } from '../../app/registry.svelte';
import ParamPanel from './ParamPanel.svelte';
import { paramPanel } from './controllers';

registry.addPanel({
  id: 'params',
  order: 30,
  place: 'side',
  vehicleComponent: ParamPanel,
  needs: 'parameters',
  rail: { title: 'Params', icon: 'sliders', hint: 'Parameters (I)' },
  isOpen: () => paramPanel.open,
  toggle: () => paramPanel.toggle(),
  close: () => paramPanel.close(),
});
registry.addKeys([
  { order: 160, keys: 'I', description: 'Parameters: search, read, set', inScene: true, handlers: { i: (facts) => registry.toggle('params', facts) } },
]);
