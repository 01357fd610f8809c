import { describe, expect, it } from 'vitest';
import { isOffered, type Panel } from '../../app/registry.svelte';
import type { TelemetrySocket } from '../../live/socket';
import type { VehicleFacts } from '../../vehicle/facts';
import { topicPanel as panel } from './panel.svelte';
import {
  domainText,
  endpointsText,
  lastMessageText,
  layoutText,
  matchingTopics,
  NO_FILTER,
  problemsTitle,
  rateText,
  readTopicList,
  stateText,
  valueText,
  type Topic,
  type TopicList,
} from './topics';

const topic = (name: string, more: Partial<Topic> = {}): Topic => ({
  name,
  type: 'px4_msgs/msg/VehicleStatus',
  publishers: 1,
  subscribers: 2,
  type_known: true,
  rate_hz: 2,
  rate_is_minimum: false,
  age_s: 0.2,
  size_bytes: 88,
  value: {},
  problem: null,
  layout: null,
  unusable: null,
  ...more,
});

const listOf = (topics: Topic[], more: Partial<TopicList> = {}): TopicList => ({
  domain_id: 7,
  namespace: 'px4_1',
  state: 'open',
  problem: null,
  topics,
  left_out: 0,
  programs: 2,
  vehicles: ['/px4_1'],
  versions: 'v1.17',
  problems: [],
  ...more,
});

describe('the list of topics', () => {
  it('is filtered by words of name and type, and by whether a topic has messages', () => {
    const allTopics = [topic('/px4_1/fmu/out/vehicle_status_v1'), topic('/camera/image', { type: 'sensor_msgs/msg/Image', age_s: null })];
    expect(matchingTopics(allTopics, NO_FILTER)).toHaveLength(2);
    expect(matchingTopics(allTopics, { text: 'OUT status', withMessages: false })).toEqual([allTopics[0]]);
    expect(matchingTopics(allTopics, { text: 'sensor_msgs', withMessages: false })).toEqual([allTopics[1]]);
    expect(matchingTopics(allTopics, { text: '', withMessages: true })).toEqual([allTopics[0]]);
  });

  it('shows rate, age, publishers and subscribers', () => {
    expect(rateText(topic('a', { rate_hz: 1.96 }))).toBe('2.0 Hz');
    expect(rateText(topic('a', { rate_hz: 1253.7, rate_is_minimum: true }))).toBe('≥ 1254 Hz');
    expect(rateText(topic('a', { rate_hz: null }))).toBe('');
    expect(lastMessageText(topic('a', { age_s: 0.5 }), 1)).toBe('1.5 s ago');
    expect(lastMessageText(topic('a', { age_s: null }), 1)).toBe('no message');
    expect(lastMessageText(topic('a', { age_s: null, publishers: 0 }), 1)).toBe('not published');
    expect(lastMessageText(topic('a', { age_s: null, type_known: false }), 1)).toBe('unknown type');
    expect(endpointsText(topic('a'))).toBe('1 publisher, 2 subscribers');
  });

  it('shows values as numbers, and null as NaN', () => {
    expect(valueText(0.1 + 0.2)).toBe('0.3');
    expect(valueText(1795478891930667)).toBe('1795478891930667');
    expect(valueText([1.5, null, true])).toBe('1.5, NaN, true');
  });

  it('shows which layout PX4 has confirmed, or what is lost without the topic', () => {
    expect(layoutText(topic('a', { layout: '1a2b3c4d' }))).toBe('Layout 1a2b3c4d, confirmed by PX4.');
    expect(layoutText(topic('a', { unusable: 'PX4 did not answer. Not available: home.' }))).toBe('PX4 did not answer. Not available: home.');
    expect(layoutText(topic('a'))).toBeNull();
  });

  it('shows who is in the domain and how many problems there are', () => {
    expect(domainText(listOf([]))).toBe(
      'Vehicles in this domain: /px4_1. Programs, with this server and PX4’s agent: 2; the layouts of this vehicle are those of PX4 v1.17.',
    );
    expect(domainText(listOf([], { vehicles: [] }))).toContain('domain: none. Programs');
    expect(domainText(listOf([], { versions: '' }))).toContain('no release of PX4 has all layouts');
    expect(problemsTitle(listOf([]))).toMatch(/No problem found$/);
    expect(problemsTitle(listOf([], { problems: ['x'] }))).toMatch(/1 problem$/);
    expect(problemsTitle(listOf([], { problems: ['x', 'y'] }))).toMatch(/2 problems$/);
  });

  it('shows the state of the discovery', () => {
    expect(stateText(null)).toBe('discovering topics …');
    expect(stateText(listOf([], { state: 'starting' }))).toBe('discovering topics …');
    expect(stateText(listOf([topic('a')], { left_out: 3 }))).toBe('DDS domain 7 · 4 topics');
    expect(stateText(listOf([], { state: 'failed', problem: 'x' }))).toBe('DDS domain 7');
    expect(readTopicList({ topics: 1 })).toBeNull();
  });
});

it('the panel is offered only for a vehicle that is connected over ROS 2', () => {
  const offered = (protocols: string[] | null): boolean => {
    const vehicleProtocols = protocols === null ? null : { protocols, telemetry: null, commands: null, setpoints: null, missing: [] };
    return isOffered({ protocol: 'ROS 2' } as Panel, { protocols: vehicleProtocols } as unknown as VehicleFacts);
  };
  expect([offered(null), offered(['MAVLink']), offered(['MAVLink', 'ROS 2'])]).toEqual([false, false, true]);
});

it('the panel shows only the topics of the watched vehicle, and clears them for another vehicle', () => {
  let stopCount = 0;
  const start = (socket: TelemetrySocket): void => void (socket.stop = () => (stopCount += 1));
  const stopWatching = panel.watch('1', 'ws://x', start);
  const sample = { vehicle: '1', topic: 'ros2_topics', vehicle_time_boot_s: null, received_unix_s: 1, value: listOf([topic('a')]) };
  panel.onFrame({ type: 'samples', samples: [{ ...sample, vehicle: '2' }] }, '1');
  expect(panel.content).toBeNull();
  panel.onFrame({ type: 'samples', samples: [sample] }, '1');
  expect(panel.content?.topics).toHaveLength(1);
  stopWatching();
  expect(stopCount).toBe(1);
  panel.watch('2', 'ws://x', start);
  expect(panel.content).toBeNull();
});
