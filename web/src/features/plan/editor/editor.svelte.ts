/** The plan editor: the document with its history, the selection, and what the next click on the map adds. */

import type { LayerEditor } from '../../../app/map-layers.svelte';
import { eastNorth, type GeoPosition } from '../../../vehicle/geo';
import {
  altitudeForNewItem,
  defaultAltitude,
  EMPTY_PLAN,
  obstaclesOf,
  partRefOf,
  type Altitude,
  type FenceZone,
  type Item,
  type PlannedHome,
  type ItemKind,
  type PatternItem,
  type Plan,
} from '../document/document';
import * as planEdit from '../document/edit';
import * as history from '../document/document';
import { newItem, titleOf } from '../document/items';
import { withItems } from '../document/pattern-items';
import * as documents from '../document-kinds';
import type { Document } from '../document-kinds';
import type { Sketch } from '../document/layer';
import * as missionEdit from '../offboard/edit';
import { isMission, type Mission, type StepKind } from '../offboard/mission';
import { missionFrameOf, type MissionFrame } from '../offboard/positions';
import { newMission, stepKindTitle } from '../offboard/step-titles';

/** The edited document and its name; one state of the history. */
export interface Draft {
  /** Identifies the opened or new plan to which this state belongs. */
  readonly documentId: number;
  readonly name: string;
  readonly plan: Document;
}

/** What the next clicks on the map add. */
export type PartToPlace =
  | { readonly type: 'item'; readonly kind: ItemKind }
  | { readonly type: 'step'; readonly kind: StepKind }
  | { readonly type: 'rally' }
  | { readonly type: 'area'; readonly use: AreaUse }
  | { readonly type: 'circle' };
export type AreaUse = 'inclusion' | 'exclusion' | 'obstacle';

const NEW_PLAN_NAME = 'New plan';
const NEW_MISSION_NAME = 'New mission';
/** Radius of a new fence circle. */
const CIRCLE_RADIUS_M = 50;
/** Top of a new obstacle, about the height of a house with two floors. */
const OBSTACLE_TOP: Altitude = { value_m: 10, reference: 'home' };
const NO_SELECTION: ReadonlySet<string> = new Set();

export class PlanEditor implements LayerEditor {
  private history = $state.raw(history.begin<Draft>({ documentId: 0, name: NEW_PLAN_NAME, plan: EMPTY_PLAN }));
  selected = $state.raw<ReadonlySet<string>>(NO_SELECTION);
  partToPlace = $state.raw<PartToPlace | null>({ type: 'item', kind: 'waypoint' });
  /** Corners of the area that is being drawn. */
  sketchCorners = $state.raw<readonly GeoPosition[]>([]);
  private documentCount = 0;
  private gestureCount = 0;
  /** A drag in progress: its start, and the document, positions by id and selection before the drag. */
  private dragInProgress: {
    group: string;
    document: Document;
    start: GeoPosition;
    positions: ReadonlyMap<string, GeoPosition>;
    selected: ReadonlySet<string>;
  } | null = null;

  readonly draft = $derived(this.history.present);
  /** The edited document, a waypoint plan or a mission. */
  readonly document = $derived(this.history.present.plan);
  /** The edited waypoint plan; empty while a mission is edited. */
  readonly plan: Plan = $derived(isMission(this.history.present.plan) ? EMPTY_PLAN : this.history.present.plan);
  /** The edited mission; null while a waypoint plan is edited. */
  readonly mission: Mission | null = $derived(isMission(this.history.present.plan) ? this.history.present.plan : null);
  /** Positions of the mission's start and of the local origin on the earth. */
  frame = $state.raw<MissionFrame>(missionFrameOf(null, null, null));
  /** The mission's path, if the server has compiled one. */
  compiled = $state.raw<documents.CompiledMission>({ flight: null, isCurrent: false });
  readonly canUndo = $derived(this.history.past.length > 0);
  readonly canRedo = $derived(this.history.future.length > 0);
  /** Rows of the selected items. */
  readonly selectedRows: readonly number[] = $derived(
    [...this.selected].flatMap((id) => {
      const ref = partRefOf(id);
      return ref?.type === 'item' ? [ref.row] : [];
    }),
  );
  readonly sketch: Sketch | null = $derived(
    this.partToPlace?.type === 'area' ? { corners: this.sketchCorners, tone: this.partToPlace.use === 'inclusion' ? 'caution' : 'danger' } : null,
  );
  readonly content = $derived(documents.layerOf(this.document, this.selected, this.sketch, this.frame, this.compiled));

  /** @param group changes of one group are undone together. */
  change(plan: Document, group: string | null = null): void {
    this.history = history.change(this.history, plan === this.document ? this.draft : { ...this.draft, plan }, group);
  }

  /**
   * Puts the items that the server has made of a pattern into the plan, without a step of the history.
   * @returns false: the plan no longer contains this pattern, or the server made no items.
   */
  completePattern(item: PatternItem, source: Document): boolean {
    const row = this.plan.items.indexOf(item);
    const made = withItems(item, isMission(source) ? undefined : source.items[0]);
    if (row < 0 || made === null) return false;
    this.history = history.amend(this.history, { ...this.draft, plan: planEdit.replaceRows(this.plan, row, 1, [made]) });
    return true;
  }

  /** Makes a change after which the selected ids may no longer be valid, and clears the selection. */
  changeAndDeselect(plan: Document): void {
    this.change(plan);
    this.select([]);
  }

  rename(name: string): void {
    this.history = history.change(this.history, { ...this.draft, name }, 'name');
  }

  /** Called when a field loses the focus: later changes are undone separately. */
  endGroup(): void {
    this.history = history.endGroup(this.history);
  }

  undo(): void {
    this.history = history.undo(this.history);
    this.pruneSelection();
  }

  redo(): void {
    this.history = history.redo(this.history);
    this.pruneSelection();
  }

  /** Opens another document; undo restores the previous document. @returns the id of the new document. */
  replace(name: string, plan: Document): number {
    this.documentCount += 1;
    this.history = history.change(this.history, { documentId: this.documentCount, name, plan });
    this.select([]);
    this.stopPlacing();
    return this.documentCount;
  }

  /** Opens the draft that was stored before a reload, with an empty history. @returns the id of the document. */
  load(name: string, plan: Document): number {
    this.documentCount += 1;
    this.history = history.begin({ documentId: this.documentCount, name, plan });
    this.stopPlacing();
    return this.documentCount;
  }

  begin(home: PlannedHome | null): void {
    this.replace(NEW_PLAN_NAME, { ...EMPTY_PLAN, planned_home: home });
    this.startPlacing({ type: 'item', kind: 'waypoint' });
  }

  beginMission(home: PlannedHome | null): void {
    this.replace(NEW_MISSION_NAME, newMission(home));
    this.startPlacing({ type: 'step', kind: 'fly' });
  }

  select(ids: Iterable<string>): void {
    this.selected = new Set(ids);
  }

  /** Selects a point; with `keepsOthers`, adds the point to the selection or removes it. For a midpoint, inserts a point. */
  pick(id: string, keepsOthers: boolean): void {
    if (documents.isMidpointId(id)) {
      const midpoint = this.content.points.find((point) => point.id === id);
      if (midpoint !== undefined) this.insert(id, midpoint);
      return;
    }
    if (id.startsWith('sketch:')) return;
    if (!keepsOthers) return this.select([id]);
    const next = new Set(this.selected);
    if (!next.delete(id)) next.add(id);
    this.selected = next;
  }

  /** Selects the range from the last selected row to `row`. */
  selectRangeTo(row: number): void {
    const lastRow = this.selectedRows.at(-1) ?? row;
    const [low, high] = [Math.min(lastRow, row), Math.max(lastRow, row)];
    this.select(Array.from({ length: high - low + 1 }, (_, i) => `item:${low + i}`));
  }

  selectAll(): void {
    this.select(documents.allStepIds(this.document));
  }

  startPlacing(part: PartToPlace): void {
    this.partToPlace = part;
    this.sketchCorners = [];
  }

  stopPlacing(): void {
    this.partToPlace = null;
    this.sketchCorners = [];
  }

  /** Handles a click on the ground: adds what `partToPlace` states, or clears the selection. @returns true: the click was handled. */
  press(position: GeoPosition): boolean {
    const part = this.partToPlace;
    if (part === null) this.select([]);
    else if (part.type === 'item') this.addItem(part.kind, position);
    else if (part.type === 'step') this.addStep(part.kind, position);
    else if (part.type === 'rally') {
      this.change({
        ...this.plan,
        rally_points: [...this.plan.rally_points, { lat_deg: position.lat_deg, lon_deg: position.lon_deg, altitude: defaultAltitude() }],
      });
      this.select([`rally:${this.plan.rally_points.length - 1}`]);
      this.stopPlacing();
    } else if (part.type === 'circle') {
      const center = { lat_deg: position.lat_deg, lon_deg: position.lon_deg };
      this.change({ ...this.document, fence: [...this.document.fence, { shape: 'circle', inclusion: true, center, radius_m: CIRCLE_RADIUS_M }] });
      this.select([`circle:${this.document.fence.length - 1}`]);
      this.stopPlacing();
    } else this.sketchCorners = [...this.sketchCorners, { lat_deg: position.lat_deg, lon_deg: position.lon_deg }];
    return true;
  }

  /** Adds an item after the selection, or without a selection at the end, but before a final landing or return. */
  addItem(kind: ItemKind, position: GeoPosition | null): void {
    const row = kind === 'takeoff' ? 0 : planEdit.FLIGHT_END_KINDS.has(kind) ? this.plan.items.length : planEdit.insertionRow(this.plan, [...this.selected]);
    this.change(planEdit.insertItem(this.plan, row, newItem(kind, position, altitudeForNewItem(this.plan, row))));
    this.select([`item:${row}`]);
    if (kind !== 'waypoint' && this.partToPlace?.type === 'item') this.stopPlacing();
  }

  /**
   * Adds a step of a mission after the selection, or without a selection at the end. For a selected trajectory, a click
   * with the kind `fly` adds a point to this trajectory.
   */
  addStep(kind: StepKind, position: GeoPosition | null): void {
    if (this.mission === null) return;
    const added = missionEdit.addStep(this.mission, kind, position, [...this.selected], this.frame);
    this.change(added.mission);
    this.select([added.id]);
    if (kind !== 'fly' && this.partToPlace?.type === 'step') this.stopPlacing();
  }

  /** Adds the drawn area as a geofence or as an obstacle. */
  addArea(use: AreaUse, polygon: readonly GeoPosition[]): void {
    if (use !== 'obstacle') return this.addZone(use === 'inclusion', polygon);
    this.change(planEdit.addObstacle(this.document, { name: '', polygon, top: OBSTACLE_TOP }));
    const index = obstaclesOf(this.document).length - 1;
    this.select(polygon.map((_, corner) => `obstacle:${index}:${corner}`));
    this.stopPlacing();
  }

  /** Adds a drawn area to the geofence. */
  addZone(inclusion: boolean, polygon: readonly GeoPosition[]): void {
    this.addZones([{ shape: 'polygon', inclusion, polygon }]);
  }

  /** Adds zones to the geofence, as one change. */
  addZones(zones: readonly FenceZone[]): void {
    this.change({ ...this.document, fence: [...this.document.fence, ...zones] });
    this.select([]);
    this.stopPlacing();
  }

  /** Inserts copies of items after the selection, as one change. */
  paste(items: readonly Item[]): void {
    const { plan, rows } = planEdit.pasteItems(this.plan, [...this.selected], items);
    this.change(plan);
    this.select(rows.map((row) => `item:${row}`));
  }

  /** The selected items, in the order of the plan. */
  selectedItems(): Item[] {
    return [...this.selectedRows].sort((a, b) => a - b).flatMap((row) => this.plan.items[row] ?? []);
  }

  /** Inserts the items or steps of a pattern after the selection, as one change. */
  insertPattern(pattern: Document): void {
    const inserted = documents.insertContent(this.document, pattern, [...this.selected]);
    this.change(inserted.document);
    this.select(inserted.ids);
  }

  /** Removes the last drawn corner, or else the selected parts. @returns false if nothing was drawn or selected. */
  remove(): boolean {
    if (this.sketchCorners.length > 0) {
      this.sketchCorners = this.sketchCorners.slice(0, -1);
      return true;
    }
    if (this.selected.size === 0) return false;
    if (this.mission !== null) {
      const [mission, ids] = [this.mission, [...this.selected]];
      this.change(documents.remove(mission, ids));
      this.select(documents.selectionAfterDelete(mission, this.document, ids, this.frame));
      return true;
    }
    const firstRow = Math.min(...(this.selectedRows.length > 0 ? this.selectedRows : [0]));
    const hadRows = this.selectedRows.length > 0;
    this.change(planEdit.remove(this.plan, [...this.selected]));
    this.select(hadRows && this.plan.items.length > 0 ? [`item:${Math.min(firstRow, this.plan.items.length - 1)}`] : []);
    return true;
  }

  /** Moves the selected rows or steps up (−1) or down (1) in the list. */
  reorder(direction: -1 | 1): void {
    if (this.mission !== null) {
      const moved = missionEdit.reorder(this.mission, [...this.selected], direction);
      if (moved === null) return;
      this.change(moved.mission);
      this.select(moved.ids);
      return;
    }
    const rows = [...this.selectedRows].sort((a, b) => a - b);
    const [first, last] = [rows[0], rows.at(-1)];
    if (first === undefined || last === undefined) return;
    const targetRow = direction < 0 ? first - 1 : last + 2;
    if (targetRow < 0 || targetRow > this.plan.items.length) return;
    const moved = planEdit.reorder(this.plan, rows, targetRow);
    this.change(moved.plan);
    this.select(moved.rows.map((row) => `item:${row}`));
  }

  grab(id: string): string | null {
    const isMidpoint = documents.isMidpointId(id);
    const start = this.content.points.find((point) => point.id === id);
    if (start === undefined || id.startsWith('sketch:')) return null;
    this.gestureCount += 1;
    const group = `drag ${this.gestureCount}`;
    const previousSelection = this.selected;
    const draggedId = isMidpoint ? this.insert(id, start, group) : id;
    if (!isMidpoint && !this.selected.has(id)) this.select([id]);
    const positions = new Map(
      [...this.selected]
        .map((selectedId) => [selectedId, documents.positionIn(this.document, selectedId, this.frame)] as const)
        .filter((pair): pair is [string, GeoPosition] => pair[1] !== null),
    );
    this.dragInProgress = { group, document: this.document, start, positions, selected: previousSelection };
    return draggedId;
  }

  drag(_id: string, to: GeoPosition): void {
    const currentDrag = this.dragInProgress;
    if (currentDrag !== null)
      this.change(documents.movePoints(currentDrag.document, currentDrag.positions, eastNorth(currentDrag.start, to), this.frame), currentDrag.group);
  }

  raise(by_m: number): void {
    const [currentDrag, rounded_m] = [this.dragInProgress, Number(by_m.toFixed(1))];
    if (currentDrag !== null && Number.isFinite(rounded_m))
      this.change(documents.raisePoints(currentDrag.document, currentDrag.positions.keys(), rounded_m), currentDrag.group);
  }

  drop(keep: boolean): void {
    const currentDrag = this.dragInProgress;
    this.dragInProgress = null;
    if (currentDrag === null) return;
    if (!keep) {
      this.history = history.cancelGroup(this.history, currentDrag.group);
      this.selected = currentDrag.selected;
    }
    this.endGroup();
  }

  private insert(id: string, position: GeoPosition, group: string | null = null): string {
    const inserted = documents.insertAtMidpoint(this.document, id, position, this.frame);
    if (inserted === null) return id;
    this.change(inserted.document, group);
    this.select([inserted.id]);
    return inserted.id;
  }

  /** Deselects the parts that no longer exist after an undo or redo. */
  private pruneSelection(): void {
    this.select([...this.selected].filter((id) => documents.partExists(this.document, id, this.frame)));
  }
}

/**
 * The hint's text about what the next click adds.
 * @param surface what the person clicks: the map, or the ground in the 3D view.
 */
export function placingText(part: PartToPlace, cornerCount: number, surface: 'map' | 'ground' = 'map'): string {
  if (part.type === 'item')
    return part.kind === 'waypoint'
      ? `Click ${surface === 'map' ? 'the map' : 'the ground'} to add waypoints.`
      : `Click ${surface === 'map' ? 'the map' : 'the ground'} to place “${titleOf({ kind: part.kind })}”.`;
  if (part.type === 'step')
    return part.kind === 'fly'
      ? `Click ${surface === 'map' ? 'the map' : 'the ground'} to add points to the trajectory.`
      : `Click ${surface === 'map' ? 'the map' : 'the ground'} to place “${stepKindTitle(part.kind)}”.`;
  if (part.type === 'rally') return `Click ${surface === 'map' ? 'the map' : 'the ground'} to place the rally point.`;
  if (part.type === 'circle') return `Click ${surface === 'map' ? 'the map' : 'the ground'} at the centre of the geofence circle.`;
  return `Click the corners of ${AREA_TEXTS[part.use]}${cornerCount > 0 ? ` (${cornerCount} so far)` : ''}.`;
}

const AREA_TEXTS: Readonly<Record<AreaUse, string>> = {
  inclusion: 'the area that the vehicle must not leave',
  exclusion: 'the area that the vehicle must not enter',
  obstacle: 'the obstacle',
};
