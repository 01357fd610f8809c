import { registry } from '../../app/registry.svelte';

registry.addPanel({
  id: 'topics',
  order: 35,
  place: 'side',
  load: async () => ({ vehicleComponent: (await import('./TopicPanel.svelte')).default }),
  protocol: 'ROS 2',
  rail: { title: 'Topics', icon: 'list', hint: 'ROS 2 topics (X)' },
});
registry.addKeys([
  {
    order: 165,
    keys: 'X',
    description: 'ROS 2 topics: rate, age and last message',
    inScene: true,
    handlers: { x: (facts) => registry.toggle('topics', facts) },
  },
]);
