/** Loads what the socket does not send: the fleet's present state and the telemetry of the last minutes, after each (re)connection. */

import { ofVehicle, type ApiClient } from '../api/client';
import type { TelemetryStore } from '../live/store';
import type { WireEvent, WireSample } from '../live/wire';

/** Length of the loaded telemetry [s]. */
const BACKFILL_S = 300;

type JsonObject = Record<string, unknown>;

/** The objects in a list. The list is the body, or the field `field` of the body. */
function objectsOf(body: unknown, field: string): JsonObject[] {
  const list = Array.isArray(body) ? body : (body as JsonObject | null)?.[field];
  return Array.isArray(list) ? list.filter((v): v is JsonObject => typeof v === 'object' && v !== null) : [];
}

/**
 * Loads the fleet into the store.
 * @returns the ids, and whether vehicles were removed from the store (`removedAny`). The data that the socket sent during the
 * request for such a vehicle is then removed too, although the vehicle may be connected again.
 */
export async function loadFleet(api: ApiClient, store: TelemetryStore): Promise<{ ids: readonly string[]; removedAny: boolean }> {
  const storedBefore = new Map(store.vehicles);
  const response = await api.get('/vehicles');
  if (!response.ok) return { ids: store.ids(), removedAny: false };
  const vehicles = objectsOf(response.value, 'vehicles').filter((v) => typeof v['id'] === 'string');
  const ids = vehicles.map((v) => v['id'] as string);
  // A replay may have jumped to another time during the request. The store then has a new vehicle with the same id, and
  // the response is outdated for the new vehicle.
  const unchangedVehicles = vehicles.filter((v) => store.vehicles.get(v['id'] as string) === storedBefore.get(v['id'] as string));
  const removedAny = store.keepOnly(ids);
  store.apply({ type: 'samples', samples: unchangedVehicles.flatMap(vehicleSamples) });
  return { ids, removedAny };
}

function vehicleSamples(vehicle: JsonObject): WireSample[] {
  const id = vehicle['id'] as string;
  const samples: WireSample[] = [];
  const add = (topic: string, value: unknown, reported_unix_s: unknown): void => {
    if (typeof value !== 'object' || value === null) return;
    // The time 0, because a value without a time must not replace a sample from the socket, because the socket sends some values only once.
    const received_unix_s = typeof reported_unix_s === 'number' ? reported_unix_s : 0;
    samples.push({ vehicle: id, topic, vehicle_time_boot_s: null, received_unix_s, value });
  };
  add('identity', vehicle['identity'], null);
  const topics = vehicle['topics'];
  if (typeof topics === 'object' && topics !== null) {
    for (const [topic, sample] of Object.entries(topics as Record<string, JsonObject | null>)) {
      if (sample !== null && 'value' in sample) add(topic, sample['value'], sample['received_unix_s']);
    }
  }
  return samples;
}

/** Loads a vehicle's messages and the telemetry of its last minutes, for trail and flight time. */
export async function loadHistory(api: ApiClient, store: TelemetryStore, id: string): Promise<void> {
  const vehicle = store.vehicles.get(id);
  const since_unix_s = Math.round(store.nowUnixS(id) - BACKFILL_S);
  const [history, messages] = await Promise.all([
    api.get('/vehicles/{v}/history', { params: { path: { v: id }, query: { topics: 'status,global_position', since_unix_s } } }),
    api.get('/vehicles/{v}/messages', ofVehicle(id)),
  ]);
  if (vehicle === undefined || store.vehicles.get(id) !== vehicle) return;
  if (history.ok) vehicle.applyHistory(objectsOf(history.value, 'samples') as unknown as WireSample[]);
  if (messages.ok) {
    for (const raw of objectsOf(messages.value, 'messages')) {
      const { kind, unix_s, text, severity } = raw;
      if (typeof kind !== 'string' || typeof unix_s !== 'number' || typeof text !== 'string') continue;
      vehicle.addMessage({ kind, unix_s, text, vehicle: id, severity: severity as WireEvent['severity'] });
    }
  }
  store.revision += 1;
}
