import { registry } from '../../app/registry.svelte';
import { actions } from '../../app/vehicle-actions.svelte';
import ActionBar from './ActionBar.svelte';

registry.addTo('bottom', { order: 100, component: ActionBar });
registry.addKeys([
  { order: 10, keys: 'H', description: 'Hold: immediately, no confirmation', inScene: true, handlers: { h: (facts) => actions.request('hold', facts) } },
  { order: 20, keys: 'T', description: 'Take off', inScene: true, handlers: { t: (facts) => actions.request('takeoff', facts) } },
  { order: 30, keys: 'L', description: 'Land', inScene: true, handlers: { l: (facts) => actions.request('land', facts) } },
  { order: 40, keys: 'R', description: 'Return', inScene: true, handlers: { r: (facts) => actions.request('rtl', facts) } },
  {
    order: 50,
    keys: 'Shift L',
    description: 'Land now, even if another client has control',
    inScene: false,
    handlers: { 'Shift L': (facts) => actions.request('land_now', facts) },
  },
  {
    order: 80,
    keys: 'Shift A',
    description: 'Arm or disarm',
    inScene: false,
    handlers: { 'Shift A': (facts) => actions.request(facts?.status?.value.armed === true ? 'disarm' : 'arm', facts) },
  },
  {
    order: 90,
    keys: 'Shift K',
    description: 'Stop motors: the vehicle falls',
    inScene: false,
    handlers: { 'Shift K': (facts) => actions.request('kill', facts) },
  },
]);
