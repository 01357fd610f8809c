import { registry } from '../../app/registry.svelte';
import { topicPanel } from './panel.svelte';
import TopicPanel from './TopicPanel.svelte';

registry.addPanel({
  id: 'topics',
  order: 35,
  place: 'side',
  vehicleComponent: TopicPanel,
  protocol: 'ROS 2',
  rail: { title: 'Topics', icon: 'list', hint: 'ROS 2 topics (X)' },
  isOpen: () => topicPanel.open,
  toggle: () => topicPanel.toggle(),
  close: () => topicPanel.close(),
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
