/** The document of an offboard mission (`docs/missions.md`), and its steps as one tree. Pure. */

import type { components } from '../../../api/schema';
import type { PlannedHome, SharedParts } from '../document/document';

type Schemas = components['schemas'];
type Wire = Schemas['OffboardMission'];

export type StepKind = Wire['steps'][number]['step'];
export type Action = Schemas['Actions']['link_loss'];
export type Vector = readonly [number, number, number];

/** A position in one of several frames: from the local origin, from the start of the mission, or on the earth. */
export interface MissionPosition {
  readonly position_ned_m?: Vector | null;
  readonly offset_ned_m?: Vector | null;
  readonly lat_deg?: number | null;
  readonly lon_deg?: number | null;
  readonly alt_amsl_m?: number | null;
  readonly alt_home_m?: number | null;
  /** Of a trajectory point: `yaw_ned_rad`, `stop`, `hold_s`, `corner_m`. */
  readonly [field: string]: unknown;
}

/** A step. Its other fields depend on `step`; `fields.ts` finds them by name. */
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

/** The steps of one of several vehicles. */
export interface Role {
  readonly start_ned_m?: Vector | null;
  readonly steps: readonly Step[];
}

export type Mission = Readonly<Omit<Wire, 'steps' | 'roles' | 'missions' | 'fence' | 'obstacles' | 'home'>> &
  SharedParts & {
    readonly home?: PlannedHome | null;
    readonly steps: readonly Step[];
    /** Of a mission for several vehicles, by name; such a mission has no steps of its own. */
    readonly roles?: Readonly<Record<string, Role>>;
    readonly missions: Readonly<Record<string, readonly Step[]>>;
  };

const FORMAT = 'offboard-gcs-mission';

export function isMission(document: { readonly format: string }): document is Mission {
  return document.format === FORMAT;
}

/** Keys and indexes of a value in the mission. */
export type Path = readonly (string | number)[];

export interface StepNode {
  /** The server's name of the step in findings and times: "step 3", "step 4.2", "step 6, round 1", "lead, step 2". */
  readonly place: string;
  /** A step of a called mission has the same path at each call. */
  readonly path: Path;
  readonly step: Step;
  readonly depth: number;
  readonly mark: string;
  /** Heading of the list that begins with this step. */
  readonly heading: string;
}

/** Larger trees are cut off: calls multiply their steps. */
const MAX_NODES = 3000;
const MAX_DEPTH = 24;

/** All steps in order, nested ones below their parent. */
export function nodesOf(mission: Mission): StepNode[] {
  const found: StepNode[] = [];
  const walk = (steps: readonly Step[], path: Path, prefix: string, depth: number, heading: string, called: readonly string[]): void => {
    steps.forEach((step, index) => {
      if (found.length >= MAX_NODES || depth > MAX_DEPTH) return;
      const place = `${prefix}${index + 1}`;
      const here = [...path, index];
      found.push({ place, path: here, step, depth, mark: String(index + 1), heading: index === 0 ? heading : '' });
      if (step.step === 'repeat') walk(step.steps ?? [], [...here, 'steps'], `${place}.`, depth + 1, '', called);
      if (step.step === 'branch') {
        walk(step.then ?? [], [...here, 'then'], `${place} then `, depth + 1, 'then', called);
        walk(step.otherwise ?? [], [...here, 'otherwise'], `${place} otherwise `, depth + 1, 'otherwise', called);
      }
      const name = step.step === 'call' ? (step.mission ?? '') : '';
      if (name !== '' && !called.includes(name))
        walk(mission.missions[name] ?? [], ['missions', name], `${place}, ${name} `, depth + 1, name, [...called, name]);
    });
  };
  walk(mission.steps, ['steps'], 'step ', 0, '', []);
  for (const [name, role] of Object.entries(mission.roles ?? {})) walk(role.steps, ['roles', name, 'steps'], `${name}, step `, 0, `Role ${name}`, []);
  return found;
}

/** Names of the roles; empty for a mission for one vehicle. */
export const roleNames = (mission: Mission): string[] => Object.keys(mission.roles ?? {});

/** Why these vehicles cannot fly the roles; null: each role has its own vehicle. */
export function assignmentProblem(roles: readonly string[], vehicles: Readonly<Record<string, string>>): string | null {
  const unassigned = roles.find((role) => (vehicles[role] ?? '') === '');
  if (unassigned !== undefined) return `Choose a vehicle for the role ${unassigned}.`;
  const twice = roles.find((role, index) => roles.slice(0, index).some((other) => vehicles[other] === vehicles[role]));
  return twice === undefined ? null : `Vehicle ${vehicles[twice] ?? ''} has two roles: choose another vehicle for ${twice}.`;
}

/** One position of a step: a point by its index, or the only position of a field. */
export interface PointRef {
  readonly place: string;
  readonly field: 'points' | 'center' | 'look_at' | 'place';
  readonly index: number;
}

export const stepId = (place: string): string => `step:${place}`;
export const pointId = ({ field, index, place }: PointRef): string => `point:${field}:${index}:${place}`;

/** The step name in an id of the list or the map. */
export function stepNameOf(id: string): string | null {
  if (id.startsWith('step:')) return id.slice(5);
  return pointOf(id)?.place ?? null;
}

export function pointOf(id: string): PointRef | null {
  const match = /^point:(points|center|look_at|place):(\d+):(.*)$/s.exec(id);
  return match === null ? null : { field: match[1] as PointRef['field'], index: Number(match[2]), place: match[3] ?? '' };
}

/** Path to the position inside the mission. */
export function pathOf(node: StepNode, ref: PointRef): Path {
  return ref.field === 'points' ? [...node.path, 'points', ref.index] : [...node.path, ref.field];
}

/** All positions of a step with their ids. */
export function positionsOf(node: StepNode): { ref: PointRef; at: MissionPosition }[] {
  const found = (node.step.points ?? []).map((at, index) => ({ ref: { place: node.place, field: 'points', index } as PointRef, at }));
  for (const field of ['center', 'look_at', 'place'] as const) {
    const at = node.step[field] as MissionPosition | null | undefined;
    if (at !== null && at !== undefined) found.push({ ref: { place: node.place, field, index: 0 }, at });
  }
  return found;
}

export function valueAt(document: unknown, path: Path): unknown {
  return path.reduce<unknown>(
    (value, key) => (value === null || typeof value !== 'object' ? undefined : (value as Record<string | number, unknown>)[key]),
    document,
  );
}

/** A copy of the document with one value changed. */
export function withValue<T>(document: T, path: Path, value: unknown): T {
  const [key, ...rest] = path;
  if (key === undefined) return value as T;
  if (Array.isArray(document)) return document.map((one, index) => (index === key ? withValue(one as unknown, rest, value) : (one as unknown))) as T;
  const fields = document as Record<string | number, unknown>;
  return { ...fields, [key]: withValue(fields[key], rest, value) } as T;
}
