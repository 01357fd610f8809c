/** The server's calls about plans. */

import type { ApiClient, Outcome } from '../../api/client';
import type { components } from '../../api/schema';
import type { Place } from '../../vehicle/geo';
import type { Plan } from './document';
import type { Finding } from './fixes';
import type { Power } from './conditions';
import type { Document, PlanKind } from './kinds';
import type { Flight } from './offboard/flight';
import type { Mission } from './offboard/mission';

type Schemas = components['schemas'];

/** A version of a plan, without the plan. */
export type PlanVersion = Readonly<Schemas['PlanVersion']>;
export type Pattern = Schemas['SurveyPattern'];
export type Estimates = Readonly<Schemas['PlanEstimates']>;

export interface Check {
  readonly findings: readonly Finding[];
  readonly estimates: Estimates;
  /** Of an offboard mission: its path, and what each step takes. */
  readonly flight: Flight | null;
  /** Below the flight: along it [m], and its height above home or above the start [m]. */
  readonly ground: readonly (readonly [number, number | null])[];
  readonly not_known: readonly string[];
}

export interface Area {
  readonly name: string;
  readonly outer: readonly Place[];
}

export interface Imported {
  readonly plan: Document;
  readonly areas: readonly Area[];
  readonly notes: readonly string[];
}

export interface GroundPlan {
  readonly plan: Plan;
  /** Altitudes that were resolved, those that were not, and waypoints added. */
  readonly resolved: number;
  readonly unknown: number;
  readonly added: number;
  readonly notes: readonly string[];
}

type Format = Schemas['ImportedPlan']['format'];
export type { Format };

/** Files that can be written, as people know them. */
const WAYPOINT_FORMATS = [
  { value: 'plan', text: 'QGroundControl .plan' },
  { value: 'waypoints', text: '.waypoints' },
  { value: 'geojson', text: 'GeoJSON' },
  { value: 'kml', text: 'KML' },
  { value: 'kmz', text: 'KMZ' },
  { value: 'csv', text: 'CSV' },
  { value: 'json', text: 'Offboard GCS .json' },
] as const;
export const FORMATS: Readonly<Record<PlanKind, readonly { readonly value: Format; readonly text: string }[]>> = {
  waypoint_plan: WAYPOINT_FORMATS,
  offboard_mission: [
    { value: 'yaml', text: 'YAML' },
    { value: 'json', text: 'JSON' },
  ],
};

export const IMPORTABLE = '.plan,.waypoints,.csv,.txt,.json,.geojson,.kml,.kmz,.yaml,.yml';

/** Documents as this room edits them: more kinds of items and steps than it knows are kept as they are. */
export const sent = <D extends Document>(plan: D) => plan as unknown as D extends Mission ? Schemas['OffboardMission'] : Schemas['Plan'];
const edited = <T>(answer: Promise<Outcome<unknown>>) => answer as Promise<Outcome<T>>;

export class PlanApi {
  constructor(private readonly api: ApiClient) {}

  list(): Promise<Outcome<{ plans: readonly PlanVersion[] }>> {
    return this.api.get('/plans');
  }

  /** @param version the newest unless named. */
  open(id: string, version: number | null = null): Promise<Outcome<PlanVersion & { plan: Document }>> {
    return edited(this.api.get('/plans/{plan}', { params: { path: { plan: id }, query: version === null ? {} : { version } } }));
  }

  /** Newest first. */
  versions(id: string): Promise<Outcome<{ versions: readonly PlanVersion[] }>> {
    return this.api.get('/plans/{plan}/versions', { params: { path: { plan: id } } });
  }

  create(name: string, plan: Document): Promise<Outcome<PlanVersion>> {
    return this.api.post('/plans', { body: { name, plan: sent(plan) } });
  }

  save(id: string, name: string, plan: Document, base_version: number): Promise<Outcome<PlanVersion>> {
    return this.api.put('/plans/{plan}', { params: { path: { plan: id } }, body: { name, plan: sent(plan), base_version } });
  }

  delete(id: string, base_version: number): Promise<Outcome<null>> {
    return this.api.delete('/plans/{plan}', { params: { path: { plan: id }, query: { base_version } } });
  }

  check(plan: Document, vehicle: string | null, power: Power | null): Promise<Outcome<Check>> {
    return edited(this.api.post('/plans/check', { body: { plan: sent(plan), vehicle, power } }));
  }

  /** The mission that flies a waypoint plan. */
  convert(plan: Plan, name: string, vehicle: string | null): Promise<Outcome<{ plan: Mission; notes: readonly string[] }>> {
    return edited(this.api.post('/plans/convert', { body: { plan: sent(plan), name, vehicle } }));
  }

  /** @param tolerance_m waypoints are added between items above the ground until lines are within it; null: none. */
  followGround(plan: Plan, tolerance_m: number | null): Promise<Outcome<GroundPlan>> {
    return edited(this.api.post('/plans/ground', { body: { plan: sent(plan), tolerance_m } }));
  }

  /** @param altitude_m above home, of points that have none. */
  import(file: File, altitude_m: number | null): Promise<Outcome<Imported>> {
    const query = { filename: file.name, ...(altitude_m === null ? {} : { altitude_m }) };
    const headers = { 'Content-Type': 'application/octet-stream' };
    return edited(this.api.post('/plans/import', { params: { query }, body: file, bodySerializer: (body) => body, headers }));
  }

  export(plan: Document, format: Format): Promise<Outcome<{ file: Blob; notes: readonly string[] }>> {
    return this.api.download('/plans/export', { params: { query: { format } }, body: { plan: sent(plan) } }, 'X-Plan-Notes');
  }

  pattern(pattern: Pattern): Promise<Outcome<{ plan: Plan }>> {
    return edited(this.api.post('/plans/pattern', { body: pattern }));
  }
}
