/** One interface for both kinds of documents: waypoint plans and offboard missions. Pure functions. */

import type { LayerContent, LayerPosition } from '../../app/map-layers.svelte';
import { positionAt, type EastNorth, type GeoPosition } from '../../vehicle/geo';
import { altitudeForNewItem, positionOf, allPositions, partRefOf, areaPositionOf, areaPositions, type PlannedHome, type Plan } from './document/document';
import * as planEdit from './document/edit';
import { newItem } from './document/items';
import { parseMidpointId, planLayer, type Sketch } from './document/layer';
import * as missionEdit from './offboard/edit';
import type { CompiledFlight } from './offboard/mission';
import { isMission, nodesOf, pathOf, positionsOf, pointId, pointRefOf, stepId, valueAt, type Mission, type MissionPosition } from './offboard/mission';
import { missionEntries, missionLayer, parseLegMidpointId } from './offboard/mission-layer';
import { geoPointOf, type MissionFrame } from './offboard/positions';
import { planEntries, type ListEntry } from './document/list-entries';

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
export function positionIn(document: Document, id: string, frame: MissionFrame): GeoPosition | null {
  if (!isMission(document)) return positionOf(document, id);
  const ref = pointRefOf(id);
  if (ref !== null) {
    const node = missionEdit.nodeOf(document, id);
    const position = node === null ? undefined : (valueAt(document, pathOf(node, ref)) as MissionPosition | undefined);
    return position == null ? null : geoPointOf(position, frame);
  }
  if (id === 'home') return document.home ?? null;
  return areaPositionOf(document, partRefOf(id));
}

/** The positions of the part with this id; for a step, the positions of all its points. */
export function positionsOfId(document: Document, id: string, frame: MissionFrame): GeoPosition[] {
  if (isMission(document) && id.startsWith('step:')) {
    const node = missionEdit.nodeOf(document, id);
    return node === null ? [] : positionsOf(node).map(({ position }) => geoPointOf(position, frame));
  }
  return [positionIn(document, id, frame) ?? []].flat();
}

/** Moves points by the same horizontal offset. @param positions positions of the points before the move, by id. */
export function movePoints<D extends Document>(document: D, positions: ReadonlyMap<string, GeoPosition>, offset: EastNorth, frame: MissionFrame): D {
  let movedDocument: Document = document;
  for (const [id, position] of positions) {
    const target = positionAt(position, offset);
    movedDocument = isMission(movedDocument) ? missionEdit.movePoint(movedDocument, id, target, frame) : planEdit.movePoint(movedDocument, id, target);
  }
  return movedDocument as D;
}

/** Changes the altitudes of several points by `by_m`; negative: down. */
export function raisePoints<D extends Document>(document: D, ids: Iterable<string>, by_m: number): D {
  let raisedDocument: Document = document;
  for (const id of ids)
    raisedDocument = isMission(raisedDocument) ? missionEdit.raisePoint(raisedDocument, id, by_m) : planEdit.raisePoint(raisedDocument, id, by_m);
  return raisedDocument as D;
}

export function remove(document: Document, ids: readonly string[]): Document {
  return isMission(document) ? missionEdit.remove(document, ids) : planEdit.remove(document, ids);
}

/** Inserts a point at a midpoint. @returns null: the id is not that of a midpoint. */
export function insertAtMidpoint(document: Document, id: string, position: GeoPosition, frame: MissionFrame): { document: Document; id: string } | null {
  const pointInsertion = parseLegMidpointId(id);
  if (pointInsertion !== null && isMission(document)) {
    const inserted = missionEdit.insertPoint(document, pointInsertion.place, pointInsertion.index, position, frame);
    return inserted === null ? null : { document: inserted.mission, id: inserted.id };
  }
  const insertion = parseMidpointId(id);
  if (insertion === null) return null;
  if ('zone' in insertion)
    return { document: planEdit.insertCorner(document, insertion.zone, insertion.corner, position), id: `corner:${insertion.zone}:${insertion.corner}` };
  if ('obstacle' in insertion)
    return {
      document: planEdit.insertObstacleCorner(document, insertion.obstacle, insertion.corner, position),
      id: `obstacle:${insertion.obstacle}:${insertion.corner}`,
    };
  if (isMission(document)) return null;
  return {
    document: planEdit.insertItem(document, insertion.row, newItem('waypoint', position, altitudeForNewItem(document, insertion.row))),
    id: `item:${insertion.row}`,
  };
}

/**
 * Inserts the items or steps of another document after the selection, or without a selection at the end, but before a
 * final landing or return. @returns the ids of the inserted items or steps.
 */
export function insertContent(document: Document, source: Document, selected: readonly string[]): { document: Document; ids: string[] } {
  if (isMission(document)) {
    const inserted = missionEdit.addSteps(document, isMission(source) ? source.steps : [], selected);
    return { document: inserted.mission, ids: inserted.ids };
  }
  const items = isMission(source) ? [] : source.items;
  const row = planEdit.insertionRow(document, selected);
  return { document: planEdit.insertItems(document, row, items), ids: items.map((_, i) => `item:${row + i}`) };
}

export function isMidpointId(id: string): boolean {
  return parseMidpointId(id) !== null || parseLegMidpointId(id) !== null;
}

/** The flight that the server last compiled from the mission. */
export interface CompiledMission {
  /** Null: the server has not compiled the mission yet. */
  readonly flight: CompiledFlight | null;
  /** False: the flight was compiled before the last change. */
  readonly isCurrent: boolean;
}

/**
 * Position of the plan's start; altitudes above home are relative to its altitude. Without home: the first point of the
 * plan, at sea level.
 * @param drawnPosition a position of the area that is being drawn, used for a plan without points.
 */
export function startOf(document: Document, frame: MissionFrame, drawnPosition?: GeoPosition): Required<LayerPosition> {
  const first = isMission(document) ? undefined : allPositions(document)[0];
  const { lat_deg, lon_deg } = frame.isStartKnown ? frame.start : (first ?? drawnPosition ?? frame.start);
  return { lat_deg, lon_deg, alt_amsl_m: frame.start.alt_amsl_m };
}

export function layerOf(
  document: Document,
  selected: ReadonlySet<string>,
  sketch: Sketch | null,
  frame: MissionFrame,
  compiled: CompiledMission,
): LayerContent {
  if (!isMission(document)) return planLayer(document, selected, sketch, startOf(document, frame));
  return missionLayer(document, selected, sketch, frame, compiled.flight, compiled.isCurrent);
}

export function entriesOf(document: Document, flight: CompiledFlight | null): ListEntry[] {
  return isMission(document) ? missionEntries(document, flight?.steps ?? []) : planEntries(document);
}

/** All positions, to fit them into the view. */
export function allPositionsOf(document: Document, frame: MissionFrame, flight: CompiledFlight | null = null): GeoPosition[] {
  if (!isMission(document)) return allPositions(document);
  const stepPositions = nodesOf(document).flatMap((node) => positionsOf(node).map(({ position }) => geoPointOf(position, frame)));
  const pathPositions = (flight?.legs ?? []).flatMap(({ points }) => points.map(([, north_m, east_m]) => positionAt(frame.origin, { north_m, east_m })));
  return [frame.start, ...stepPositions, ...pathPositions, ...areaPositions(document)];
}

/** Ids of all steps or items, to select them. */
export function allStepIds(document: Document): string[] {
  return isMission(document) ? nodesOf(document).map((node) => stepId(node.place)) : document.items.map((_, row) => `item:${row}`);
}

/** Whether the part with this id exists. */
export function partExists(document: Document, id: string, frame: MissionFrame): boolean {
  if (isMission(document) && id.startsWith('step:')) return missionEdit.nodeOf(document, id) !== null;
  const ref = partRefOf(id);
  if (ref?.type === 'item') return !isMission(document) && ref.row < document.items.length;
  return positionIn(document, id, frame) !== null;
}

/**
 * The parts of a mission to select after a deletion: the step or point that now has the id of a deleted part, or else
 * the trajectory point before the deleted point. Empty for a waypoint plan.
 */
export function selectionAfterDelete(oldDocument: Document, newDocument: Document, ids: readonly string[], frame: MissionFrame): string[] {
  if (!isMission(oldDocument) || !isMission(newDocument)) return [];
  const remainingId = ids.find((id) => partExists(newDocument, id, frame));
  if (remainingId !== undefined) return [remainingId];
  const point = ids.map(pointRefOf).find((ref) => ref !== null && ref?.field === 'points');
  if (point != null && point.index > 0) return [pointId({ ...point, index: point.index - 1 })].filter((id) => partExists(newDocument, id, frame));
  return [];
}
