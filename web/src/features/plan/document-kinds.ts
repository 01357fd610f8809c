/** One interface for both kinds of documents: waypoint plans and offboard missions. Pure. */

import type { LayerPicture, LayerPosition } from '../../app/map-layers.svelte';
import { positionAt, type EastNorth, type GeoPosition } from '../../vehicle/geo';
import { altitudeBefore, positionOf, allPositions, refOf, sharedPositionOf, sharedPositions, type PlannedHome, type Plan } from './document/document';
import * as edit from './document/edit';
import { newItem } from './document/items';
import { insertionOf, picture, type Sketch } from './document/layer';
import * as offboard from './offboard/edit';
import type { CompiledFlight } from './offboard/compiled-path';
import { isMission, nodesOf, pathOf, positionsOf, pointId, pointOf, stepId, valueAt, type Mission, type MissionPosition } from './offboard/mission';
import * as missionPicture from './offboard/mission-layer';
import { geoPointOf, type Frame } from './offboard/positions';
import { treeOf, type TreeEntry } from './document/list-entries';

export type Document = Plan | Mission;

export const KIND_NAMES = { waypoint_plan: 'Waypoint plan', offboard_mission: 'Offboard mission' } as const;
export type PlanKind = keyof typeof KIND_NAMES;

export function kindOf(document: Document): PlanKind {
  return isMission(document) ? 'offboard_mission' : 'waypoint_plan';
}

export function homeOf(document: Document): PlannedHome | null {
  return (isMission(document) ? document.home : document.planned_home) ?? null;
}

export function withHome<D extends Document>(document: D, home: PlannedHome): D {
  return isMission(document) ? { ...document, home } : { ...document, planned_home: home };
}

/** Position of the part with this id; null if the part has no position or no longer exists. */
export function positionIn(document: Document, id: string, frame: Frame): GeoPosition | null {
  if (!isMission(document)) return positionOf(document, id);
  const ref = pointOf(id);
  if (ref !== null) {
    const node = offboard.nodeOf(document, id);
    const position = node === null ? undefined : (valueAt(document, pathOf(node, ref)) as MissionPosition | undefined);
    return position == null ? null : geoPointOf(position, frame);
  }
  if (id === 'home') return document.home ?? null;
  return sharedPositionOf(document, refOf(id));
}

/** The positions of the part with this id; for a step, the positions of all its points. */
export function positionsOfId(document: Document, id: string, frame: Frame): GeoPosition[] {
  if (isMission(document) && id.startsWith('step:')) {
    const node = offboard.nodeOf(document, id);
    return node === null ? [] : positionsOf(node).map(({ position }) => geoPointOf(position, frame));
  }
  return [positionIn(document, id, frame) ?? []].flat();
}

/** Moves points by the same horizontal offset. @param positions positions of the points before the move, by id. */
export function move<D extends Document>(document: D, positions: ReadonlyMap<string, GeoPosition>, offset: EastNorth, frame: Frame): D {
  let moved: Document = document;
  for (const [id, position] of positions) {
    const target = positionAt(position, offset);
    moved = isMission(moved) ? offboard.movePoint(moved, id, target, frame) : edit.movePoint(moved, id, target);
  }
  return moved as D;
}

/** Changes the altitudes of several points by `by_m`; negative: down. */
export function raise<D extends Document>(document: D, ids: Iterable<string>, by_m: number): D {
  let raised: Document = document;
  for (const id of ids) raised = isMission(raised) ? offboard.raisePoint(raised, id, by_m) : edit.raisePoint(raised, id, by_m);
  return raised as D;
}

export function remove(document: Document, ids: readonly string[]): Document {
  return isMission(document) ? offboard.remove(document, ids) : edit.remove(document, ids);
}

/** Inserts a point at a midpoint. @returns null: the id is not that of a midpoint. */
export function insertAt(document: Document, id: string, position: GeoPosition, frame: Frame): { document: Document; id: string } | null {
  const pointInsertion = missionPicture.pointInsertionOf(id);
  if (pointInsertion !== null && isMission(document)) {
    const inserted = offboard.insertPoint(document, pointInsertion.place, pointInsertion.index, position, frame);
    return inserted === null ? null : { document: inserted.mission, id: inserted.id };
  }
  const insertion = insertionOf(id);
  if (insertion === null) return null;
  if ('zone' in insertion)
    return { document: edit.insertCorner(document, insertion.zone, insertion.corner, position), id: `corner:${insertion.zone}:${insertion.corner}` };
  if ('obstacle' in insertion)
    return {
      document: edit.insertObstacleCorner(document, insertion.obstacle, insertion.corner, position),
      id: `obstacle:${insertion.obstacle}:${insertion.corner}`,
    };
  if (isMission(document)) return null;
  return {
    document: edit.insertItem(document, insertion.row, newItem('waypoint', position, altitudeBefore(document, insertion.row))),
    id: `item:${insertion.row}`,
  };
}

/**
 * Inserts the items or steps of another document after the selection, or without a selection at the end, but before a
 * final landing or return. @returns the ids of the inserted items or steps.
 */
export function insertAll(document: Document, source: Document, selected: readonly string[]): { document: Document; ids: string[] } {
  if (isMission(document)) {
    const inserted = offboard.addSteps(document, isMission(source) ? source.steps : [], selected);
    return { document: inserted.mission, ids: inserted.ids };
  }
  const items = isMission(source) ? [] : source.items;
  const row = edit.rowToInsert(document, selected);
  return { document: edit.insertItems(document, row, items), ids: items.map((_, i) => `item:${row + i}`) };
}

export function isInsertion(id: string): boolean {
  return insertionOf(id) !== null || missionPicture.pointInsertionOf(id) !== null;
}

/** The newest flight that the server has compiled from a mission; null: none yet. */
export interface CompiledMission {
  readonly flight: CompiledFlight | null;
  /** False: the flight was compiled before the last change. */
  readonly isCurrent: boolean;
}

/**
 * Start of the plan, with the altitude to which altitudes above home are relative. Without home: the first point, at sea
 * level.
 * @param drawnPosition a position of the area that is being drawn, used for a plan without points.
 */
export function startOf(document: Document, frame: Frame, drawnPosition?: GeoPosition): Required<LayerPosition> {
  const first = isMission(document) ? undefined : allPositions(document)[0];
  const { lat_deg, lon_deg } = frame.known ? frame.start : (first ?? drawnPosition ?? frame.start);
  return { lat_deg, lon_deg, alt_amsl_m: frame.start.alt_amsl_m };
}

export function pictureOf(document: Document, selected: ReadonlySet<string>, sketch: Sketch | null, frame: Frame, compiled: CompiledMission): LayerPicture {
  if (!isMission(document)) return picture(document, selected, sketch, startOf(document, frame));
  return missionPicture.picture(document, selected, sketch, frame, compiled.flight, compiled.isCurrent);
}

export function entriesOf(document: Document, flight: CompiledFlight | null): TreeEntry[] {
  return isMission(document) ? missionPicture.treeOf(document, flight?.steps ?? []) : treeOf(document);
}

/** All positions, to fit them into the view. */
export function allPositionsOf(document: Document, frame: Frame, flight: CompiledFlight | null = null): GeoPosition[] {
  if (!isMission(document)) return allPositions(document);
  const stepPositions = nodesOf(document).flatMap((node) => positionsOf(node).map(({ position }) => geoPointOf(position, frame)));
  const pathPositions = (flight?.legs ?? []).flatMap(({ points }) => points.map(([, north_m, east_m]) => positionAt(frame.origin, { north_m, east_m })));
  return [frame.start, ...stepPositions, ...pathPositions, ...sharedPositions(document)];
}

/** Ids of all steps or items, to select them. */
export function allStepIds(document: Document): string[] {
  return isMission(document) ? nodesOf(document).map((node) => stepId(node.place)) : document.items.map((_, row) => `item:${row}`);
}

/** Whether the part with this id exists. */
export function exists(document: Document, id: string, frame: Frame): boolean {
  if (isMission(document) && id.startsWith('step:')) return offboard.nodeOf(document, id) !== null;
  const ref = refOf(id);
  if (ref?.type === 'item') return !isMission(document) && ref.row < document.items.length;
  return positionIn(document, id, frame) !== null;
}

/**
 * The parts of a mission to select after a deletion: the step or point that now has the id of a deleted part, or else
 * the trajectory point before the deleted point. Empty for a waypoint plan.
 */
export function selectionAfterDelete(oldDocument: Document, newDocument: Document, ids: readonly string[], frame: Frame): string[] {
  if (!isMission(oldDocument) || !isMission(newDocument)) return [];
  const remaining = ids.find((id) => exists(newDocument, id, frame));
  if (remaining !== undefined) return [remaining];
  const point = ids.map(pointOf).find((ref) => ref !== null && ref?.field === 'points');
  if (point != null && point.index > 0) return [pointId({ ...point, index: point.index - 1 })].filter((id) => exists(newDocument, id, frame));
  return [];
}
