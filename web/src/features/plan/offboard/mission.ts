/** The document of an offboard mission (`docs/missions.md`), and its steps as a tree. Pure functions. */

import type { components } from '../../../api/schema';
import type { Tone } from '../../../app/map-layers.svelte';
import type { PlannedHome, DocumentAreas } from '../document/document';

type Schemas = components['schemas'];
type ApiMission = Schemas['OffboardMission'];

export type StepKind = ApiMission['steps'][number]['step'];
export type Action = Schemas['Actions']['link_loss'];
export type Vector = readonly [number, number, number];

/** A position in one of several frames: relative to the local origin or to the start of the mission, or in lat/lon. */
export interface MissionPosition {
  readonly position_ned_m?: Vector | null;
  readonly offset_ned_m?: Vector | null;
  readonly lat_deg?: number | null;
  readonly lon_deg?: number | null;
  readonly alt_amsl_m?: number | null;
  readonly alt_home_m?: number | null;
  /** A trajectory point also has `yaw_ned_rad`, `stop`, `hold_s` and `corner_m`. */
  readonly [field: string]: unknown;
}

/** A step. The further fields depend on `step`; `fields.ts` reads them by name. */
export interface Step {
  readonly step: StepKind;
  readonly name?: string | null;
  readonly points?: readonly MissionPosition[];
  readonly steps?: readonly Step[];
  readonly then?: readonly Step[];
  readonly otherwise?: readonly Step[];
  readonly mission?: string;
  readonly [field: string]: unknown;
}

/** The planned start and the steps of one role; one vehicle flies a role. */
export interface Role {
  readonly start_ned_m?: Vector | null;
  readonly steps: readonly Step[];
}

export type Mission = Readonly<Omit<ApiMission, 'steps' | 'roles' | 'missions' | 'fence' | 'obstacles' | 'home'>> &
  DocumentAreas & {
    readonly home?: PlannedHome | null;
    readonly steps: readonly Step[];
    /** The roles of a mission for several vehicles, by name; the field `steps` of such a mission is empty. */
    readonly roles?: Readonly<Record<string, Role>>;
    /** Lists of steps by name; a `call` step flies one of these lists. */
    readonly missions: Readonly<Record<string, readonly Step[]>>;
  };

const FORMAT = 'offboard-gcs-mission';

export function isMission(document: { readonly format: string }): document is Mission {
  return document.format === FORMAT;
}

/** Keys and indexes that lead to a value in the mission. */
export type JsonPath = readonly (string | number)[];

export interface StepNode {
  /** The server's name of the step in findings and times: "step 3", "step 4.2", "step 6, round 1", "lead, step 2". */
  readonly place: string;
  /** Path of the step in the document; a step of a called list has the same path at each call. */
  readonly path: JsonPath;
  readonly step: Step;
  /** Nesting depth. */
  readonly depth: number;
  /** Number of the step in its list. */
  readonly numberText: string;
  /** Heading of the list of steps that begins with this step; empty for the other steps. */
  readonly listHeading: string;
}

/** Limits for the number and the nesting depth of steps, because nested calls multiply the steps. */
const MAX_NODES = 3000;
const MAX_DEPTH = 24;

/** A name as the server has it: of words that are no texts, so that it is the same in every language. */
const named = (...words: readonly (string | number)[]): string => words.join(' ');

/** All steps in order; nested steps follow their parent. A list that calls itself is not expanded again. */
export function nodesOf(mission: Mission): StepNode[] {
  const nodes: StepNode[] = [];
  const walk = (
    steps: readonly Step[],
    path: JsonPath,
    placeOf: (number: number) => string,
    depth: number,
    listHeading: string,
    callingLists: readonly string[],
  ): void => {
    steps.forEach((step, index) => {
      if (nodes.length >= MAX_NODES || depth > MAX_DEPTH) return;
      const place = placeOf(index + 1);
      const stepPath = [...path, index];
      nodes.push({ place, path: stepPath, step, depth, numberText: String(index + 1), listHeading: index === 0 ? listHeading : '' });
      if (step.step === 'repeat') walk(step.steps ?? [], [...stepPath, 'steps'], (n) => `${place}.${n}`, depth + 1, '', callingLists);
      if (step.step === 'branch') {
        walk(step.then ?? [], [...stepPath, 'then'], (n) => named(place, 'then', n), depth + 1, 'then', callingLists);
        walk(step.otherwise ?? [], [...stepPath, 'otherwise'], (n) => named(place, 'otherwise', n), depth + 1, 'otherwise', callingLists);
      }
      const name = step.step === 'call' ? (step.mission ?? '') : '';
      if (name !== '' && !callingLists.includes(name))
        walk(mission.missions[name] ?? [], ['missions', name], (n) => named(`${place},`, name, n), depth + 1, name, [...callingLists, name]);
    });
  };
  walk(mission.steps, ['steps'], (n) => named('step', n), 0, '', []);
  for (const [name, role] of Object.entries(mission.roles ?? {}))
    walk(role.steps, ['roles', name, 'steps'], (n) => named(`${name},`, 'step', n), 0, `Role ${name}`, []);
  return nodes;
}

/** Names of the roles; empty for a mission for one vehicle. */
export const roleNames = (mission: Mission): string[] => Object.keys(mission.roles ?? {});

const ROLE_TONES: readonly Tone[] = ['target', 'id2', 'id3', 'id4', 'actual'];

/** Colour of a role's path; from the sixth role on they repeat. */
export const roleTone = (roles: readonly string[], role: string): Tone => ROLE_TONES[Math.max(0, roles.indexOf(role)) % ROLE_TONES.length] ?? 'target';

/** Why these vehicles cannot fly the roles; null: each role has a different vehicle. */
export function assignmentProblem(roles: readonly string[], vehicles: Readonly<Record<string, string>>): string | null {
  const unassignedRole = roles.find((role) => (vehicles[role] ?? '') === '');
  if (unassignedRole !== undefined) return `Choose a vehicle for the role “${unassignedRole}”.`;
  const duplicateRole = roles.find((role, index) => roles.slice(0, index).some((other) => vehicles[other] === vehicles[role]));
  return duplicateRole === undefined ? null : `Vehicle ${vehicles[duplicateRole] ?? ''} has two roles. Choose another vehicle for the role “${duplicateRole}”.`;
}

/** Refers to one position of a step: a point by its index, or the position in another field (index 0). */
export interface PointRef {
  readonly place: string;
  readonly field: 'points' | 'center' | 'look_at' | 'place';
  readonly index: number;
}

export const stepId = (place: string): string => `step:${place}`;
export const pointId = ({ field, index, place }: PointRef): string => `point:${field}:${index}:${place}`;

/** The server's name of the step to which an id of the list or the map belongs. */
export function stepPlaceOf(id: string): string | null {
  if (id.startsWith('step:')) return id.slice(5);
  return pointRefOf(id)?.place ?? null;
}

/** Parses the id of a point; null: the id of another part. */
export function pointRefOf(id: string): PointRef | null {
  const match = /^point:(points|center|look_at|place):(\d+):(.*)$/s.exec(id);
  return match === null ? null : { field: match[1] as PointRef['field'], index: Number(match[2]), place: match[3] ?? '' };
}

/** Path of the position in the document. */
export function pathOf(node: StepNode, ref: PointRef): JsonPath {
  return ref.field === 'points' ? [...node.path, 'points', ref.index] : [...node.path, ref.field];
}

/** All positions of a step, with references to them. */
export function positionsOf(node: StepNode): { ref: PointRef; position: MissionPosition }[] {
  const positions = (node.step.points ?? []).map((position, index) => ({ ref: { place: node.place, field: 'points', index } as PointRef, position }));
  for (const field of ['center', 'look_at', 'place'] as const) {
    const position = node.step[field] as MissionPosition | null | undefined;
    if (position !== null && position !== undefined) positions.push({ ref: { place: node.place, field, index: 0 }, position });
  }
  return positions;
}

/** The value at a path; undefined: there is none. */
export function valueAt(document: unknown, path: JsonPath): unknown {
  return path.reduce<unknown>(
    (value, key) => (value === null || typeof value !== 'object' ? undefined : (value as Record<string | number, unknown>)[key]),
    document,
  );
}

/** A copy of the document with one value changed. */
export function withValue<T>(document: T, path: JsonPath, value: unknown): T {
  const [key, ...rest] = path;
  if (key === undefined) return value as T;
  if (Array.isArray(document))
    return document.map((element, index) => (index === key ? withValue(element as unknown, rest, value) : (element as unknown))) as T;
  const fields = document as Record<string | number, unknown>;
  return { ...fields, [key]: withValue(fields[key], rest, value) } as T;
}

export type StepTime = Readonly<Schemas['PlanStepTime']>;
export type Leg = Readonly<Omit<Schemas['PlanLeg'], 'points'>> & { readonly points: readonly (readonly [number, number, number, number])[] };
export type CompiledFlight = Readonly<Omit<Schemas['OffboardFlight'], 'legs'>> & { readonly legs: readonly Leg[] };
