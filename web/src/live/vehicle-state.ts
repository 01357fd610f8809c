/** All data about a vehicle: the newest sample of each topic, trail, flight time and messages. */

import { updatedPeriod, staleAfterS } from './age';
import { updatedClock, NO_FLIGHT, type FlightClock } from './flight-time';
import { Trail } from './trail';
import type { GlobalPosition, Status, TopicName, Topics } from './topics';
import type { WireEvent, WireSample } from './wire';

export interface Identity {
  system_id: number | null;
  autopilot: number | null;
  vehicle_type: number | null;
  /** The autopilot's unique id. */
  uid: string | null;
  /** Null until it is known whether the vehicle is simulated. */
  simulated: boolean | null;
  replayed: boolean;
  firmware: string | null;
  warnings: string[];
}

export const UNKNOWN_IDENTITY: Identity = {
  system_id: null,
  autopilot: null,
  vehicle_type: null,
  uid: null,
  simulated: null,
  replayed: false,
  firmware: null,
  warnings: [],
};

export interface StoredSample {
  value: unknown;
  received_unix_s: number;
  /** Measured period of the topic; null: not measured yet. */
  period_s: number | null;
}

/** A value with its age. */
export interface Reading<T> {
  value: T;
  age_s: number;
  stale: boolean;
}

export interface Message {
  /** Identifies the message: time, kind and text of the event. */
  key: string;
  unix_s: number;
  severity: number;
  kind: string;
  text: string;
}

const MAX_MESSAGES = 200;

export class VehicleState {
  readonly id: string;
  identity: Identity = UNKNOWN_IDENTITY;
  /** Identifies the vehicle behind the id: replaced when another vehicle reports under the id. */
  incarnation: object = {};
  readonly trail = new Trail();
  flight: FlightClock = NO_FLIGHT;
  /** Messages, newest first. */
  messages: Message[] = [];
  private readonly samples = new Map<string, StoredSample>();

  constructor(id: string) {
    this.id = id;
  }

  /** Whether the server has sent the vehicle's identity, and the vehicle is not replayed. */
  get isLive(): boolean {
    return this.samples.has('identity') && !this.identity.replayed;
  }

  /** Stores a sample unless the stored sample of its topic is newer. @returns whether it was stored. */
  apply(sample: WireSample): boolean {
    const previousSample = this.samples.get(sample.topic);
    if (previousSample !== undefined && sample.received_unix_s < previousSample.received_unix_s) return false;
    const gap = previousSample === undefined ? 0 : sample.received_unix_s - previousSample.received_unix_s;
    this.samples.set(sample.topic, {
      value: sample.value,
      received_unix_s: sample.received_unix_s,
      period_s: updatedPeriod(previousSample?.period_s ?? null, gap),
    });
    if (sample.topic === 'identity') this.setIdentity(toIdentity(sample.value));
    if (sample.topic === 'status') this.flight = updatedClock(this.flight, sample.value as Status, sample.received_unix_s);
    if (sample.topic === 'global_position') this.trail.add(sample.value as GlobalPosition);
    return true;
  }

  private setIdentity(identity: Identity): void {
    if (isOtherVehicle(this.identity, identity)) this.incarnation = {};
    this.identity = identity;
  }

  /** Adds older samples, oldest first, to trail and flight time; the newest values do not change. */
  applyHistory(samples: readonly WireSample[]): void {
    let clock = NO_FLIGHT;
    const positions: GlobalPosition[] = [];
    for (const sample of samples) {
      if (sample.topic === 'status') clock = updatedClock(clock, sample.value as Status, sample.received_unix_s);
      if (sample.topic === 'global_position') positions.push(sample.value as GlobalPosition);
    }
    this.trail.prepend(positions);
    const status = this.samples.get('status');
    if (status !== undefined) clock = updatedClock(clock, status.value as Status, status.received_unix_s);
    if (clock.updated_unix_s > 0) this.flight = clock;
  }

  /** Adds a message; an event that is received twice is added once. */
  addMessage(event: WireEvent): void {
    const key = `${event.unix_s}|${event.kind}|${event.text}`;
    if (event.text === '' || this.messages.some((m) => m.key === key)) return;
    const message = { key, unix_s: event.unix_s, severity: severityNumber(event.severity), kind: event.kind, text: event.text };
    const index = this.messages.findIndex((m) => m.unix_s <= message.unix_s);
    this.messages.splice(index === -1 ? this.messages.length : index, 0, message);
    this.messages.length = Math.min(this.messages.length, MAX_MESSAGES);
  }

  /** The newest sample of a topic; null before the first sample. */
  newestSample(topic: string): StoredSample | null {
    return this.samples.get(topic) ?? null;
  }

  /** The newest value of a topic with its age at `now_unix_s`; null before the first sample. */
  read<K extends TopicName>(topic: K, now_unix_s: number): Reading<Topics[K]> | null {
    return this.readAs<Topics[K]>(topic, now_unix_s);
  }

  readAs<T>(topic: string, now_unix_s: number): Reading<T> | null {
    const sample = this.samples.get(topic);
    if (sample === undefined || sample.value === null) return null;
    const age_s = Math.max(0, now_unix_s - sample.received_unix_s);
    return { value: sample.value as T, age_s, stale: age_s > staleAfterS(topic, sample.period_s) };
  }

  get armed(): boolean {
    return (this.samples.get('status')?.value as Status | null | undefined)?.armed ?? false;
  }

  /** Whether the server has lost its connection to the vehicle; true before the first status. */
  get linkLost(): boolean {
    return (this.samples.get('status')?.value as Status | null | undefined)?.link_lost ?? true;
  }
}

const SEVERITIES = ['emergency', 'alert', 'critical', 'error', 'warning', 'notice', 'info', 'debug'];

/** The MAV_SEVERITY from a number or a name; unknown values give 6 (info). */
export function severityNumber(severity: string | number | null): number {
  if (typeof severity === 'number') return Math.min(7, Math.max(0, Math.round(severity)));
  const index = severity === null ? -1 : SEVERITIES.indexOf(severity.toLowerCase());
  return index === -1 ? 6 : index;
}

/** Whether two identities are of different vehicles; a value that is not known yet is no difference. */
function isOtherVehicle(before: Identity, now: Identity): boolean {
  const fields = ['system_id', 'autopilot', 'vehicle_type', 'uid'] as const;
  return (
    fields.some((field) => before[field] !== null && now[field] !== null && before[field] !== now[field]) ||
    (before.system_id !== null && before.replayed !== now.replayed)
  );
}

/** Reads the known fields of an identity; other versions of the server may send more or fewer fields. */
function toIdentity(value: unknown): Identity {
  if (typeof value !== 'object' || value === null) return UNKNOWN_IDENTITY;
  const raw = value as Record<string, unknown>;
  const number = (name: string): number | null => (typeof raw[name] === 'number' ? raw[name] : null);
  return {
    system_id: number('system_id'),
    autopilot: number('autopilot'),
    vehicle_type: number('vehicle_type'),
    uid: typeof raw['uid'] === 'string' ? raw['uid'] : null,
    simulated: typeof raw['simulated'] === 'boolean' ? raw['simulated'] : null,
    replayed: raw['replayed'] === true,
    firmware: typeof raw['firmware'] === 'string' ? raw['firmware'] : null,
    warnings: Array.isArray(raw['warnings']) ? raw['warnings'].filter((w): w is string => typeof w === 'string') : [],
  };
}
