/** Edits of a mission. Pure: each function returns a new mission. */

import { pointLabel } from './mission-layer';
import { moveHomeOrArea, removeHomeAndAreas } from '../document/edit';
import type { GeoPosition } from '../../../vehicle/geo';
import {
  nodesOf,
  pathOf,
  stepPlaceOf,
  pointId,
  pointRefOf,
  roleNames,
  stepId,
  valueAt,
  withValue,
  type Mission,
  type MissionPosition,
  type JsonPath,
  type Step,
  type StepKind,
  type StepNode,
  type PointRef,
} from './mission';
import { movedTo, raisedBy, positionInFrame, geoPointOf, positionFrameOf, type MissionFrame, type GeoPoint, type PositionFrame } from './positions';
import { newStep, KINDS_WITH_POSITION, stepTitle } from './step-titles';

/** Altitude of a new point without a neighbour, above the start [m]. */
const DEFAULT_UP_M = 10;

export function nodeOf(mission: Mission, id: string): StepNode | null {
  const place = stepPlaceOf(id);
  return place === null ? null : (nodesOf(mission).find((node) => node.place === place) ?? null);
}

export function setStep(mission: Mission, node: StepNode, step: Step): Mission {
  return withValue(mission, node.path, step);
}

/** Moves the point with this id. */
export function movePoint(mission: Mission, id: string, position: GeoPosition, frame: MissionFrame): Mission {
  const ref = pointRefOf(id);
  const node = ref === null ? null : nodeOf(mission, id);
  if (ref === null || node === null) return moveHomeOrArea(mission, id, position);
  const path = pathOf(node, ref);
  const oldPosition = valueAt(mission, path) as MissionPosition | undefined;
  return oldPosition === undefined ? mission : withValue(mission, path, movedTo(oldPosition, position, frame));
}

/** Changes the altitude of the point with this id by `by_m`; home and the geofence have no altitude. */
export function raisePoint(mission: Mission, id: string, by_m: number): Mission {
  const ref = pointRefOf(id);
  const node = ref === null ? null : nodeOf(mission, id);
  const path = ref === null || node === null ? null : pathOf(node, ref);
  const oldPosition = path === null ? undefined : (valueAt(mission, path) as MissionPosition | undefined);
  return path === null || oldPosition === undefined ? mission : withValue(mission, path, raisedBy(oldPosition, by_m));
}

function splice<T>(list: readonly T[], start: number, removeCount: number, ...added: readonly T[]): T[] {
  return [...list.slice(0, start), ...added, ...list.slice(start + removeCount)];
}

const listPathOf = (path: JsonPath): JsonPath => path.slice(0, -1);
const indexOf = (path: JsonPath): number => Number(path.at(-1));
const pathKey = (path: JsonPath): string => JSON.stringify(path);

/** Removes steps and points. A step is removed with its last point or its centre. */
export function remove(mission: Mission, ids: readonly string[]): Mission {
  const removedSteps = new Map<string, JsonPath>();
  const removedPoints = new Map<string, { node: StepNode; indexes: Set<number> }>();
  for (const id of ids) {
    const node = nodeOf(mission, id);
    if (node === null) continue;
    const ref = pointRefOf(id);
    if (ref?.field === 'look_at') continue;
    if (ref?.field === 'points') {
      const entry = removedPoints.get(pathKey(node.path)) ?? { node, indexes: new Set() };
      removedPoints.set(pathKey(node.path), { node, indexes: entry.indexes.add(ref.index) });
    } else removedSteps.set(pathKey(node.path), node.path);
  }
  let next = removeHomeAndAreas(mission, ids);
  for (const [key, { node, indexes }] of removedPoints) {
    const remainingPoints = (node.step.points ?? []).filter((_, index) => !indexes.has(index));
    if (remainingPoints.length === 0) removedSteps.set(key, node.path);
    else next = withValue(next, [...node.path, 'points'], remainingPoints);
  }
  // The deepest and last steps are removed first, so that the paths of the other steps stay valid.
  const paths = [...removedSteps.values()].sort((a, b) => b.length - a.length || indexOf(b) - indexOf(a));
  for (const path of paths) {
    const list = valueAt(next, listPathOf(path));
    if (Array.isArray(list)) next = withValue(next, listPathOf(path), splice(list as readonly Step[], indexOf(path), 1));
  }
  return next;
}

/** Inserts a point into a step at `index`, with the frame and altitude of a neighbouring point. */
export function insertPoint(
  mission: Mission,
  place: string,
  index: number,
  position: GeoPosition,
  frame: MissionFrame,
): { mission: Mission; id: string } | null {
  const node = nodeOf(mission, stepId(place));
  const points = node?.step.points;
  if (node === null || points === undefined) return null;
  const template = points[index - 1] ?? points[index];
  const point =
    template === undefined ? positionInFrame('offset', { ...position, up_m: DEFAULT_UP_M }, frame) : positionOnly(movedTo(template, position, frame));
  const next = withValue(mission, [...node.path, 'points'], splice(points, index, 0, point));
  return { mission: next, id: pointId({ place, field: 'points', index }) };
}

/** The position without the other fields of the point. */
function positionOnly(point: MissionPosition): MissionPosition {
  const { yaw_ned_rad: _yaw, hold_s: _hold, stop: _stop, ...position } = point;
  return position;
}

/**
 * A new position, in the frame of the previous position. The first position is in lat/lon if the start is known.
 * @param nodeCount number of nodes before the new step.
 */
function newPosition(mission: Mission, position: GeoPosition | null, frame: MissionFrame, nodeCount: number, nodes: readonly StepNode[]): MissionPosition {
  const positionsBefore = nodes
    .slice(0, nodeCount)
    .flatMap((node): readonly MissionPosition[] | MissionPosition => node.step.points?.at(-1) ?? (node.step['center'] as MissionPosition | undefined) ?? []);
  const template = positionsBefore.at(-1);
  const positionFrame: PositionFrame = template !== undefined ? positionFrameOf(template) : frame.isStartKnown && mission.home != null ? 'home' : 'offset';
  const takeoffHeight_m = nodes.find((node) => node.step.step === 'take_off')?.step['height_m'];
  const up_m = template !== undefined ? geoPointOf(template, frame).up_m : typeof takeoffHeight_m === 'number' ? takeoffHeight_m : DEFAULT_UP_M;
  const geoPoint: GeoPoint = { ...(position ?? (template === undefined ? frame.start : geoPointOf(template, frame))), up_m };
  return positionInFrame(positionFrame, geoPoint, frame);
}

/**
 * Adds a step after the selection, into a selected empty branch, or without a selection at the end, but before a final
 * landing. If a trajectory is selected, `fly` with a position adds a point to the trajectory instead.
 */
export function addStep(
  mission: Mission,
  kind: StepKind,
  position: GeoPosition | null,
  selected: readonly string[],
  frame: MissionFrame,
): { mission: Mission; id: string } {
  const nodes = nodesOf(mission);
  const lastStep = lastSelectedStep(mission, selected);
  if (kind === 'fly' && position !== null && lastStep?.step.step === 'fly') {
    const ref = selected
      .map(pointRefOf)
      .filter((point) => point?.field === 'points')
      .at(-1);
    const added = insertPoint(mission, lastStep.place, ref == null ? (lastStep.step.points?.length ?? 0) : ref.index + 1, position, frame);
    if (added !== null) return added;
  }
  const nodeCount = lastStep === null ? nodes.length : nodes.indexOf(lastStep) + 1;
  const step = newStep(kind, KINDS_WITH_POSITION.has(kind) ? newPosition(mission, position, frame, nodeCount, nodes) : undefined);
  const { mission: next, places } = insertSteps(mission, [step], lastStep);
  const place = places[0] ?? '';
  return { mission: next, id: kind === 'fly' ? pointId({ place, field: 'points', index: 0 }) : stepId(place) };
}

/** The last selected step; null: no step is selected. */
export function lastSelectedStep(mission: Mission, selected: readonly string[]): StepNode | null {
  return (
    selected
      .map((id) => nodeOf(mission, id))
      .filter((node) => node !== null)
      .at(-1) ?? null
  );
}

/** Inserts several steps where `addStep` would insert a step. @returns the mission and the ids of the inserted steps. */
export function addSteps(mission: Mission, steps: readonly Step[], selected: readonly string[]): { mission: Mission; ids: string[] } {
  const lastStep = lastSelectedStep(mission, selected);
  const { mission: next, places } = insertSteps(mission, steps, lastStep);
  return { mission: next, ids: places.map(stepId) };
}

/**
 * Path at which a step is inserted: after the selected step or into its empty branch, or without a selection at the end,
 * but before a final landing. A take-off is inserted at the beginning.
 */
function insertionPath(mission: Mission, kind: StepKind | undefined, selectedNode: StepNode | null): JsonPath {
  const [role] = roleNames(mission);
  let listPath: JsonPath = role === undefined ? ['steps'] : ['roles', role, 'steps'];
  let index = role === undefined ? mission.steps.length : (mission.roles?.[role]?.steps.length ?? 0);
  if (selectedNode !== null && kind !== 'take_off') {
    const isEmptyBranch = selectedNode.step.step === 'branch' && (selectedNode.step.then ?? []).length === 0;
    listPath = isEmptyBranch ? [...selectedNode.path, 'then'] : listPathOf(selectedNode.path);
    index = isEmptyBranch ? 0 : indexOf(selectedNode.path) + 1;
  }
  if (kind === 'take_off') index = 0;
  const steps = (valueAt(mission, listPath) ?? []) as readonly Step[];
  if (kind !== 'land' && steps[index - 1]?.step === 'land' && listPath.length === (listPath[0] === 'roles' ? 3 : 1)) index -= 1;
  return [...listPath, index];
}

/** Path at which `addStep` would insert a call. */
export function callInsertionPath(mission: Mission, selected: readonly string[]): JsonPath {
  return insertionPath(mission, 'call', lastSelectedStep(mission, selected));
}

/** Id of the step at a path; null: there is no step. */
export function stepIdAt(mission: Mission, path: JsonPath): string | null {
  const node = nodesOf(mission).find((candidate) => pathKey(candidate.path) === pathKey(path));
  return node === undefined ? null : stepId(node.place);
}

/** Inserts steps one after the other; the first step at the path from `insertionPath`. */
function insertSteps(mission: Mission, added: readonly Step[], selectedNode: StepNode | null): { mission: Mission; places: string[] } {
  const path = insertionPath(mission, added[0]?.step, selectedNode);
  const [listPath, index] = [listPathOf(path), indexOf(path)];
  const steps = (valueAt(mission, listPath) ?? []) as readonly Step[];
  const next = withValue(mission, listPath, splice(steps, index, 0, ...added));
  const placeOf = new Map(nodesOf(next).map((node) => [pathKey(node.path), node.place]));
  return { mission: next, places: added.map((_, i) => placeOf.get(pathKey([...listPath, index + i])) ?? '') };
}

/** Adds a step at the end of one list of a branch step. */
export function addToBranch(mission: Mission, node: StepNode, list: 'then' | 'otherwise'): { mission: Mission; id: string } {
  const steps = (node.step[list] ?? []) as readonly Step[];
  const next = withValue(mission, [...node.path, list], [...steps, newStep('hold')]);
  return { mission: next, id: stepId(`${node.place} ${list} ${steps.length + 1}`) };
}

/** Adds a new list of steps to the mission, and makes the call step call this list. */
export function addCalledList(mission: Mission, node: StepNode): Mission {
  let number = 1;
  while (mission.missions[`part ${number}`] !== undefined) number += 1;
  const name = `part ${number}`;
  const extendedMission = { ...mission, missions: { ...mission.missions, [name]: [newStep('hold')] } };
  return setStep(extendedMission, node, { ...node.step, mission: name });
}

/**
 * Moves steps of one list up (−1) or down (1).
 * @returns null: the steps cannot be moved further, or are in several lists.
 */
export function reorder(mission: Mission, ids: readonly string[], direction: -1 | 1): { mission: Mission; ids: string[] } | null {
  const paths = [
    ...new Map(
      ids
        .map((id) => nodeOf(mission, id)?.path ?? null)
        .filter((path) => path !== null)
        .map((path) => [pathKey(path), path]),
    ).values(),
  ];
  const [first] = paths;
  if (first === undefined || paths.some((path) => pathKey(listPathOf(path)) !== pathKey(listPathOf(first)))) return null;
  const list = valueAt(mission, listPathOf(first)) as readonly Step[];
  const movedIndexes = new Set(paths.map(indexOf));
  const neighbourIndex = direction < 0 ? Math.min(...movedIndexes) - 1 : Math.max(...movedIndexes) + 1;
  const neighbour = list[neighbourIndex];
  if (neighbour === undefined) return null;
  const targetIndex = direction < 0 ? Math.max(...movedIndexes) : Math.min(...movedIndexes);
  const withoutNeighbour = splice(list, neighbourIndex, 1);
  const next = withValue(mission, listPathOf(first), splice(withoutNeighbour, targetIndex, 0, neighbour));
  const movedKeys = new Set([...movedIndexes].map((index) => pathKey([...listPathOf(first), index + direction])));
  return {
    mission: next,
    ids: nodesOf(next)
      .filter((node) => movedKeys.has(pathKey(node.path)))
      .map((node) => stepId(node.place)),
  };
}

export interface SelectedStep {
  readonly node: StepNode;
  /** The selected point; null: the whole step. */
  readonly ref: PointRef | null;
  /** Title of the card that edits the step. */
  readonly title: string;
}

/** The selected step; null: no step is selected, or several steps are. */
export function selectedStep(mission: Mission, ids: readonly string[]): SelectedStep | null {
  const [firstId, ...otherIds] = ids;
  const node = firstId === undefined ? null : nodeOf(mission, firstId);
  if (firstId === undefined || node === null || otherIds.some((id) => stepPlaceOf(id) !== node.place)) return null;
  const ref = otherIds.length === 0 ? pointRefOf(firstId) : null;
  const ownTitle = stepTitle(node.step);
  const count = node.step.points?.length ?? 0;
  const title =
    ref?.field === 'points'
      ? `Point ${pointLabel(node, ref.index, count)}`
      : node.step.name != null && node.step.name !== ''
        ? ownTitle
        : `${ownTitle} ${node.numberText}`;
  return { node, ref: ref?.field === 'points' ? ref : null, title };
}

/** Limits of the document format. */
export const MAX_TABLES = 20;
const MAX_NAME_LENGTH = 100;

/** A trajectory from a file, as the server read it. */
export interface Table {
  readonly name: string;
  readonly text: string;
}

/** All steps, including those of lists that no step calls. */
function allSteps(mission: Mission): Step[] {
  const lists = [mission.steps, ...Object.values(mission.roles ?? {}).map((role) => role.steps), ...Object.values(mission.missions)];
  const withNestedSteps = (steps: readonly Step[]): Step[] =>
    steps.flatMap((step) => [step, ...withNestedSteps(step.steps ?? []), ...withNestedSteps(step.then ?? []), ...withNestedSteps(step.otherwise ?? [])]);
  return lists.flatMap(withNestedSteps);
}

/** The name of the table, with a number if the mission has another table with this name and other content. */
function uniqueName(tables: Readonly<Record<string, string>>, { name, text }: Table): string {
  let candidate = name;
  for (let number = 2; tables[candidate] !== undefined && tables[candidate] !== text; number += 1) {
    const suffix = ` ${number}.csv`;
    candidate = name.replace(/\.csv$/, '').slice(0, MAX_NAME_LENGTH - suffix.length) + suffix;
  }
  return candidate;
}

/**
 * Stores a table in the mission and makes the step fly it. The previous table of the step is removed unless another
 * step uses it.
 * @returns null: the mission has too many tables.
 */
export function withTable(mission: Mission, node: StepNode, table: Table): Mission | null {
  const oldName = node.step['file'];
  const withoutTable = setStep(mission, node, { ...node.step, file: null });
  const isStillUsed = allSteps(withoutTable).some((step) => step['file'] === oldName);
  const keptTables = Object.fromEntries(Object.entries(mission.tables ?? {}).filter(([name]) => isStillUsed || name !== oldName));
  const name = uniqueName(keptTables, table);
  if (keptTables[name] === undefined && Object.keys(keptTables).length >= MAX_TABLES) return null;
  return setStep({ ...mission, tables: { ...keptTables, [name]: table.text } }, node, { ...node.step, file: name });
}
