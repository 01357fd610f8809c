/** State of the panel of ROS 2 topics. The panel has a separate telemetry socket, open only while the panel is open. */

import { TelemetrySocket } from '../../live/socket';
import type { Frame } from '../../live/wire';
import { NO_FILTER, readTopicList, type Filter, type TopicList } from './topics';

const TOPIC = 'ros2_topics';
const RATE_HZ = 2;

class TopicPanel {
  filter = $state.raw<Filter>(NO_FILTER);
  /** Name and type of the topic whose last message is shown; null: none. */
  expandedTopic = $state<string | null>(null);
  content = $state.raw<TopicList | null>(null);
  /** Time at which `content` was received, by `performance.now()`. */
  received_ms = $state(0);

  /** Receives the topics of a vehicle until the returned function is called. @param start starts the socket; replaced in tests. */
  watch(vehicle: string, url: string, start = (socket: TelemetrySocket): void => socket.start()): () => void {
    this.content = null;
    this.expandedTopic = null;
    const subscription = { vehicles: [vehicle], topics: [TOPIC], rate_hz: RATE_HZ };
    const socket = new TelemetrySocket(
      url,
      () => subscription,
      (frame) => this.onFrame(frame, vehicle),
      () => undefined,
      () => true,
    );
    start(socket);
    return () => socket.stop();
  }

  onFrame(frame: Frame, vehicle: string): void {
    if (frame.type !== 'samples') return;
    for (const sample of frame.samples) {
      const content = sample.topic === TOPIC && sample.vehicle === vehicle ? readTopicList(sample.value) : null;
      if (content === null) continue;
      this.content = content;
      this.received_ms = performance.now();
    }
  }
}

export const topicPanel = new TopicPanel();
