/** The protocols of a vehicle's links, and the features that the links support. Pure functions. */

import type { components } from '../api/schema';

export type Reach = Readonly<components['schemas']['Reach']>;
/** A feature that only MAVLink supports. */
export type Feature = Reach['missing'][number];

/** Whether a link of the vehicle supports a feature; true before the server has sent `reach`. */
export function linkSupports(facts: { readonly reach: Reach | null }, feature: Feature): boolean {
  return facts.reach === null || !facts.reach.missing.includes(feature);
}

/** Lines (name, text) about the link: its protocols; and the protocols of telemetry, commands and setpoints, if these three differ. */
export function reachLines(reach: Reach | null): [string, string][] {
  if (reach === null || reach.protocols.length === 0) return [];
  const protocols = [...new Set([reach.telemetry, reach.commands, reach.setpoints])];
  const lines: [string, string][] = [['Protocol', reach.protocols.join(' and ')]];
  if (protocols.length > 1) {
    lines.push(['Telemetry', reach.telemetry ?? '–'], ['Commands', reach.commands ?? '–'], ['Setpoints', reach.setpoints ?? '–']);
  }
  if (reach.missing.length > 0) lines.push(['Not available without MAVLink', reach.missing.map((feature) => feature.replace('_', ' ')).join(', ')]);
  return lines;
}
