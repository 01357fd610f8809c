/** The state of a vehicle at one time, for all features; null: not known. */

import type { components } from '../api/schema';
import { readOffboard, type OffboardStatus } from './offboard';
import { groundDistance_m } from './geo';
import { isAirborne } from '../live/flight-time';
import type { Attitude, Battery, Component, Gimbal, GlobalPosition, Gps, Health, Home, Hud, LocalPosition, Orbit, Status } from '../live/topics';
import type { Reading, VehicleState } from '../live/vehicle-state';
import { readControl, type Control } from './control';
import { vehicleName } from './names';

export interface VehicleFacts {
  id: string;
  name: string;
  now_unix_s: number;
  /** No connection between vehicle and server, or between server and this page. */
  lost: boolean;
  /** No connection between server and this page; the state of the vehicle's link is then unknown. */
  offline: boolean;
  /** Null until it is known whether the vehicle is simulated. */
  simulated: boolean | null;
  replayed: boolean;
  /** Not landed; true also while the vehicle takes off or lands. */
  inAir: boolean;
  status: Reading<Status> | null;
  attitude: Reading<Attitude> | null;
  localPosition: Reading<LocalPosition> | null;
  globalPosition: Reading<GlobalPosition> | null;
  hud: Reading<Hud> | null;
  gps: Reading<Gps> | null;
  battery: Reading<Battery> | null;
  home: Reading<Home> | null;
  health: Reading<Health> | null;
  gimbal: Reading<Gimbal> | null;
  /** The circle of mode Orbit, as the vehicle last reported it. */
  orbit: Reading<Orbit> | null;
  offboard: (OffboardStatus & { age_s: number }) | null;
  /** Who may command the vehicle; null for a replay, and before the server has sent it. */
  control: Control | null;
  /** Horizontal distance from home. */
  homeDistance_m: number | null;
  /** Components that have sent a heartbeat: autopilot, gimbals, cameras, companion computers. */
  components: readonly Component[];
  /** Protocols of the vehicle's links, and features that need another protocol; null before the server has sent them. */
  protocols: Protocols | null;
}

/** The facts of a vehicle at `now_unix_s`. @param connected whether the page is connected to the server. */
export function vehicleFacts(vehicle: VehicleState, now_unix_s: number, connected: boolean): VehicleFacts {
  const status = vehicle.read('status', now_unix_s);
  const globalPosition = vehicle.read('global_position', now_unix_s);
  const home = vehicle.read('home', now_unix_s);
  const offboardReading = vehicle.readAs<unknown>('offboard', now_unix_s);
  const offboard = offboardReading === null ? null : readOffboard(offboardReading.value);
  return {
    id: vehicle.id,
    name: vehicleName(vehicle.id, vehicle.identity),
    now_unix_s,
    lost: !connected || vehicle.linkLost,
    offline: !connected,
    simulated: vehicle.identity.simulated,
    replayed: vehicle.identity.replayed,
    inAir: status !== null && isAirborne(status.value.landed_state),
    status,
    globalPosition,
    home,
    attitude: vehicle.read('attitude', now_unix_s),
    localPosition: vehicle.read('local_position', now_unix_s),
    hud: vehicle.read('hud', now_unix_s),
    gps: vehicle.read('gps', now_unix_s),
    battery: vehicle.read('battery', now_unix_s),
    health: vehicle.read('health', now_unix_s),
    gimbal: vehicle.read('gimbal', now_unix_s),
    orbit: vehicle.read('orbit', now_unix_s),
    offboard: offboard === null || offboardReading === null ? null : { ...offboard, age_s: offboardReading.age_s },
    control: readControl(vehicle.newestSample('control')?.value),
    components: vehicle.readAs<readonly Component[]>('components', now_unix_s)?.value ?? [],
    protocols: vehicle.readAs<Protocols>('reach', now_unix_s)?.value ?? null,
    homeDistance_m: globalPosition === null || home === null ? null : groundDistance_m(home.value, globalPosition.value),
  };
}

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
