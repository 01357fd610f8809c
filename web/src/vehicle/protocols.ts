/** The protocols of a vehicle's links, and the features that need another protocol. Pure functions. */

import type { components } from '../api/schema';

export type Protocols = Readonly<components['schemas']['Reach']>;
export type Protocol = 'MAVLink' | 'ROS 2';
/** A feature that only MAVLink supports. */
export type Feature = Protocols['missing'][number];

interface VehicleProtocols {
  /** Null: the server has not sent the protocols yet. */
  readonly protocols: Protocols | null;
}

export function hasProtocol({ protocols }: VehicleProtocols, protocol: Protocol): boolean {
  return protocols?.protocols.includes(protocol) === true;
}

/** Whether a link of the vehicle supports a feature; true before the server has sent the protocols. */
export function linkSupports({ protocols }: VehicleProtocols, feature: Feature): boolean {
  return protocols === null || !protocols.missing.includes(feature);
}

/** Lines (name, text) about the link: its protocols; and the protocols of telemetry, commands and setpoints, if these three differ. */
export function protocolLines(protocols: Protocols | null): [string, string][] {
  if (protocols === null || protocols.protocols.length === 0) return [];
  const { telemetry, commands, setpoints, missing } = protocols;
  const lines: [string, string][] = [['Protocol', protocols.protocols.join(' and ')]];
  if (new Set([telemetry, commands, setpoints]).size > 1) {
    lines.push(['Telemetry', telemetry ?? '–'], ['Commands', commands ?? '–'], ['Setpoints', setpoints ?? '–']);
  }
  if (missing.length > 0) lines.push(['Not available without MAVLink', missing.map((feature) => feature.replace('_', ' ')).join(', ')]);
  return lines;
}
