import { registry } from '../../app/registry.svelte';
import { readinessPanel } from './controllers';
import ReadinessPanel from './ReadinessPanel.svelte';

registry.addPanel({
  id: 'readiness',
  order: 20,
  place: 'side',
  vehicleComponent: ReadinessPanel,
  needs: 'arming_report',
  isOpen: () => readinessPanel.open,
  toggle: () => readinessPanel.toggle(),
  close: () => readinessPanel.close(),
});
registry.addKeys([
  {
    order: 150,
    keys: 'Y',
    description: 'Readiness: why the vehicle cannot be armed or fly in a mode',
    inScene: true,
    handlers: { y: (facts) => registry.toggle('readiness', facts) },
  },
]);
