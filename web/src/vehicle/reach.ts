/** Over which protocols a vehicle is reached, and what its links carry. Pure. */

import type { components } from '../api/schema';

export type Reach = Readonly<components['schemas']['Reach']>;
/** What only MAVLink carries. */
export type Feature = Reach['missing'][number];

/** Whether the vehicle's links carry this; true before the server has sent `reach`. */
export function carries(facts: { readonly reach: Reach | null }, feature: Feature): boolean {
  return facts.reach === null || !facts.reach.missing.includes(feature);
}

/** Lines for the details of the link: the protocols, and which of them carries telemetry, commands and setpoints. */
export function reachLines(reach: Reach | null): [string, string][] {
  if (reach === null || reach.protocols.length === 0) return [];
  const protocols = [...new Set([reach.telemetry, reach.commands, reach.setpoints])];
  const lines: [string, string][] = [['Protocol', reach.protocols.join(' and ')]];
  if (protocols.length > 1) {
    lines.push(['Telemetry', reach.telemetry ?? '–'], ['Commands', reach.commands ?? '–'], ['Setpoints', reach.setpoints ?? '–']);
  }
  if (reach.missing.length > 0) lines.push(['Not available without MAVLink', reach.missing.map((each) => each.replace('_', ' ')).join(', ')]);
  return lines;
}
