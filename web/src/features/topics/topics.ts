/** Filter and texts of the panel of ROS 2 topics. Pure functions. */

import type { components } from '../../api/schema';
import { ageText } from '../../live/age';

export type Topic = components['schemas']['Ros2Topic'];
export type TopicList = components['schemas']['Ros2Topics'];

export interface Filter {
  text: string;
  /** Only topics with a message. */
  withMessages: boolean;
}

export const NO_FILTER: Filter = { text: '', withMessages: false };
/** After this time without an update the panel shows a warning [s]. */
export const STALE_AFTER_S = 3;

/** Reads the server's list of topics from a telemetry value; null if the value has another format. */
export function readTopicList(value: unknown): TopicList | null {
  return typeof value === 'object' && value !== null && Array.isArray((value as TopicList).topics) ? (value as TopicList) : null;
}

/** Topics whose name or type contains each word of the filter. */
export function matchingTopics(topics: readonly Topic[], filter: Filter): Topic[] {
  const words = filter.text.toLowerCase().split(/\s+/).filter(Boolean);
  return topics.filter((topic) => {
    const text = `${topic.name} ${topic.type}`.toLowerCase();
    return words.every((word) => text.includes(word)) && (!filter.withMessages || topic.age_s !== null);
  });
}

export function rateText(topic: Topic): string {
  if (topic.rate_hz === null) return '';
  const rate = topic.rate_hz < 10 ? topic.rate_hz.toFixed(1) : topic.rate_hz.toFixed(0);
  return `${topic.rate_is_minimum ? '≥ ' : ''}${rate} Hz`;
}

/** Age of the last message, or why there is none. @param since_s time since the list of topics was received. */
export function lastMessageText(topic: Topic, since_s: number): string {
  if (topic.age_s !== null) return `${ageText(topic.age_s + since_s)} ago`;
  if (topic.publishers === 0) return 'not published';
  return topic.type_known ? 'no message' : 'unknown type';
}

/** Number of publishers and subscribers. */
export function endpointsText(topic: Topic): string {
  const count = (n: number, word: string): string => `${n} ${word}${n === 1 ? '' : 's'}`;
  return `${count(topic.publishers, 'publisher')}, ${count(topic.subscribers, 'subscriber')}`;
}

/** The layout of a topic's messages, or why the server does not use the topic; null: nothing to say. */
export function layoutText(topic: Topic): string | null {
  if (topic.layout != null) return `Layout ${topic.layout}, confirmed by PX4.`;
  return topic.unusable ?? null;
}

/** Who is in the domain: vehicles, programs, and the releases of PX4 whose layouts the vehicle has. */
export function domainText(list: TopicList): string {
  const vehicles = list.vehicles.length === 0 ? 'none' : list.vehicles.join(', ');
  const layouts = list.versions === '' ? 'no release of PX4 has all layouts of this vehicle' : `the layouts of this vehicle are those of PX4 ${list.versions}`;
  return `Vehicles in this domain: ${vehicles}. Programs, with this server and PX4’s agent: ${list.programs}; ${layouts}.`;
}

export function problemsTitle({ problems }: TopicList): string {
  const count = problems.length === 0 ? 'No problem found' : `${problems.length} ${problems.length === 1 ? 'problem' : 'problems'}`;
  return `Topics empty, setpoints without effect? ${count}`;
}

/** What is said if no problem was found. */
export const NO_PROBLEM =
  'Each topic of PX4 that a program uses has the same name and type on a vehicle. Setpoints also need Offboard mode. A program that is missing here is in another DDS domain (ROS_DOMAIN_ID) or on another network; “gcs doctor ros2” searches the domains 0 to 9.';

/** A field's value as text. The server sends null for NaN and infinite values; their text is NaN. */
export function valueText(value: unknown): string {
  if (Array.isArray(value)) return value.map(valueText).join(', ');
  if (value === null) return 'NaN';
  if (typeof value === 'number') return String(Number.isInteger(value) ? value : Number(value.toPrecision(7)));
  return String(value);
}

/** DDS domain and number of topics, or the progress of the discovery. */
export function stateText(list: TopicList | null): string {
  if (list === null || list.state === 'starting') return 'discovering topics …';
  const domain = `DDS domain ${list.domain_id}`;
  const count = list.topics.length + list.left_out;
  return list.state === 'failed' ? domain : `${domain} · ${count} ${count === 1 ? 'topic' : 'topics'}`;
}
