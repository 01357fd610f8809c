/** API calls about plans. */

import type { ApiClient, Outcome } from '../../api/client';
import type { components } from '../../api/schema';
import type { GeoPosition } from '../../vehicle/geo';
import type { Pattern, Plan } from './document/document';
import type { Finding } from './document/fixes';
import type { Power } from './dry-run/conditions';
import type { Document, PlanKind } from './document-kinds';
import type { CompiledFlight } from './offboard/mission';
import type { Mission, JsonPath } from './offboard/mission';

type Schemas = components['schemas'];

/** Metadata of one version of a plan. */
export type PlanVersion = Readonly<Schemas['PlanVersion']>;
export type Estimates = Readonly<Schemas['PlanEstimates']>;

export interface Check {
  readonly findings: readonly Finding[];
  readonly estimates: Estimates;
  /** Path and step durations of an offboard mission; null for a waypoint plan. */
  readonly flight: CompiledFlight | null;
  /** Terrain below the path: distance along the path [m], altitude of the terrain above home or above the start [m]. */
  readonly ground: readonly (readonly [number, number | null])[];
  readonly not_known: readonly string[];
}

/** An area in an imported file. The file does not state its use: a person chooses one of `uses`. */
export type Area = Readonly<Schemas['ImportedArea']>;
export type AreaUse = Readonly<Schemas['ImportedAreaUse']>;

/** What a file does not state: the altitude of points without an altitude (above home), or what its altitudes are above. */
export type ImportAnswer = Readonly<{ altitude_m?: number; altitude_reference?: Schemas['Altitude']['reference'] }>;

/** A plan from a file, and the areas of the file, which a person can add as geofences. */
export interface ImportedFile {
  readonly plan: Document;
  readonly areas: readonly Area[];
  readonly notes: readonly string[];
}

/** A generated pattern: `plan` contains its items or steps; the map shows `path` and `lines`. */
export interface GeneratedPattern {
  readonly plan: Document;
  readonly path: readonly Readonly<Schemas['PatternPosition']>[];
  readonly lines: readonly (readonly [GeoPosition, GeoPosition])[];
  readonly figures: Readonly<Schemas['PatternFigures']>;
  readonly notes: readonly string[];
}

/** `resolved` and `unknown` are numbers of altitudes, `added` is the number of added waypoints. */
export interface ResolvedPlan {
  readonly plan: Plan;
  readonly resolved: number;
  readonly unknown: number;
  readonly added: number;
  readonly notes: readonly string[];
}

/** The edited mission after a stored mission was inserted. */
export interface InsertedMission {
  readonly plan: Mission;
  /** Name of the list of steps that the call step flies. */
  readonly called: string;
  readonly notes: readonly string[];
}
/** A survey divided over several vehicles: a mission with a role for each part. */
export interface DividedSurvey {
  readonly plan: Mission;
  readonly parts: readonly Readonly<Schemas['DividedPart']>[];
  readonly notes: readonly string[];
}
/** How positions relative to start or home are inserted if the planned starts of the two missions differ. */
export type PositionHandling = NonNullable<Schemas['MissionToInsert']['positions']>;

/** A trajectory as CSV text. */
export type ImportedTable = Readonly<Schemas['ImportedTable']>;

export type Format = Schemas['ImportedPlan']['format'];

/** Export formats of waypoint plans. */
const WAYPOINT_FORMATS = [
  { value: 'plan', text: 'QGroundControl .plan' },
  { value: 'waypoints', text: '.waypoints' },
  { value: 'geojson', text: 'GeoJSON' },
  { value: 'kml', text: 'KML' },
  { value: 'kmz', text: 'KMZ' },
  { value: 'csv', text: 'CSV' },
  { value: 'json', text: 'Offboard GCS .json' },
] as const;
export const EXPORT_FORMATS: Readonly<Record<PlanKind, readonly { readonly value: Format; readonly text: string }[]>> = {
  waypoint_plan: WAYPOINT_FORMATS,
  offboard_mission: [
    { value: 'yaml', text: 'YAML' },
    { value: 'json', text: 'JSON' },
  ],
};

export const IMPORT_EXTENSIONS = '.plan,.waypoints,.csv,.txt,.json,.geojson,.kml,.kmz,.yaml,.yml';

/** Cast between the API's types and the editor's types. The editor's types also permit unknown kinds of items and steps. */
export const toApi = <D extends Document>(plan: D) => plan as unknown as D extends Mission ? Schemas['OffboardMission'] : Schemas['Plan'];
const fromApi = <T>(response: Promise<Outcome<unknown>>) => response as Promise<Outcome<T>>;

export class PlanApi {
  constructor(private readonly api: ApiClient) {}

  list(): Promise<Outcome<{ plans: readonly PlanVersion[] }>> {
    return this.api.get('/plans');
  }

  /** @param version null: the newest version. */
  open(id: string, version: number | null = null): Promise<Outcome<PlanVersion & { plan: Document }>> {
    return fromApi(this.api.get('/plans/{plan}', { params: { path: { plan: id }, query: version === null ? {} : { version } } }));
  }

  /** All versions of a plan, newest first. */
  versions(id: string): Promise<Outcome<{ versions: readonly PlanVersion[] }>> {
    return this.api.get('/plans/{plan}/versions', { params: { path: { plan: id } } });
  }

  create(name: string, plan: Document): Promise<Outcome<PlanVersion>> {
    return this.api.post('/plans', { body: { name, plan: toApi(plan) } });
  }

  save(id: string, name: string, plan: Document, base_version: number): Promise<Outcome<PlanVersion>> {
    return this.api.put('/plans/{plan}', { params: { path: { plan: id } }, body: { name, plan: toApi(plan), base_version } });
  }

  delete(id: string, base_version: number): Promise<Outcome<null>> {
    return this.api.delete('/plans/{plan}', { params: { path: { plan: id }, query: { base_version } } });
  }

  check(plan: Document, vehicle: string | null, power: Power | null): Promise<Outcome<Check>> {
    return fromApi(this.api.post('/plans/check', { body: { plan: toApi(plan), vehicle, power } }));
  }

  /** Makes the server read the vehicle's parameters for the check; the response comes after the server has read them all. */
  readParameters(vehicle: string): Promise<Outcome<unknown>> {
    return this.api.post('/vehicles/{v}/params/refresh', { params: { path: { v: vehicle } }, body: { wait: true } });
  }

  /** Converts a waypoint plan to an offboard mission. */
  convert(plan: Plan, name: string, vehicle: string | null): Promise<Outcome<{ plan: Mission; notes: readonly string[] }>> {
    return fromApi(this.api.post('/plans/convert', { body: { plan: toApi(plan), name, vehicle } }));
  }

  /**
   * Computes the AMSL altitudes of items above terrain.
   * @param tolerance_m largest permitted deviation of a leg from its height above ground. The server adds waypoints to
   * limit the deviation. Null: the server adds no waypoints.
   */
  resolveTerrain(plan: Plan, tolerance_m: number | null): Promise<Outcome<ResolvedPlan>> {
    return fromApi(this.api.post('/plans/ground', { body: { plan: toApi(plan), tolerance_m } }));
  }

  /** @param answer what the file does not state. */
  import(file: File, answer: ImportAnswer): Promise<Outcome<ImportedFile>> {
    const query = { filename: file.name, ...answer };
    const headers = { 'Content-Type': 'application/octet-stream' };
    return fromApi(this.api.post('/plans/import', { params: { query }, body: file, bodySerializer: (body) => body, headers }));
  }

  /**
   * Inserts a stored mission: its steps become a list of the mission, and a call step at `callPath` flies this list.
   * @param in_air true: the take-off and the last landing of the stored mission are left out.
   * @param positions null: the server refuses with an error on the field `positions` if the planned starts differ and
   * the path depends on the start.
   */
  insert(plan: Mission, callPath: JsonPath, plan_id: string, in_air: boolean, positions: PositionHandling | null): Promise<Outcome<InsertedMission>> {
    return fromApi(this.api.post('/plans/insert', { body: { plan: toApi(plan), at: [...callPath], plan_id, in_air, positions } }));
  }

  /** Divides the survey in a row of the plan over vehicles at their present places, or over a number of vehicles. */
  divide(plan: Plan, item: number, name: string, vehicles: readonly string[] | number, minimum_separation_m: number): Promise<Outcome<DividedSurvey>> {
    const over = typeof vehicles === 'number' ? { count: vehicles } : { vehicles: [...vehicles] };
    return fromApi(this.api.post('/plans/divide', { body: { plan: toApi(plan), item, name, minimum_separation_m, ...over } }));
  }

  /** Reads the trajectory in a CSV or NumPy (.npy) file. */
  importTable(file: File): Promise<Outcome<ImportedTable>> {
    const headers = { 'Content-Type': 'application/octet-stream' };
    return this.api.post('/plans/table', { params: { query: { filename: file.name } }, body: file, bodySerializer: (body) => body, headers });
  }

  export(plan: Document, format: Format): Promise<Outcome<{ file: Blob; notes: readonly string[] }>> {
    return this.api.download('/plans/export', { params: { query: { format } }, body: { plan: toApi(plan) } }, 'X-Plan-Notes');
  }

  /**
   * Generates a pattern as items or steps.
   * @param tolerance_m largest permitted deviation of the lines from their height above ground; null: the server does not compute
   * the AMSL altitudes of items above terrain.
   */
  pattern(pattern: Pattern, kind: PlanKind, vehicle: string | null, tolerance_m: number | null): Promise<Outcome<GeneratedPattern>> {
    const query = { document: kind, ...(vehicle === null ? {} : { vehicle }), ...(tolerance_m === null ? {} : { tolerance_m }) };
    return fromApi(this.api.post('/plans/pattern', { params: { query }, body: pattern }));
  }
}
