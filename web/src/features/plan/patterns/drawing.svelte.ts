/**
 * The pattern that is being drawn, or that is edited in the plan: its shape on the map, its settings, the server's preview.
 * A drawn pattern is inserted as one change; each change of an edited pattern is a change of the plan.
 */

import type { LayerEditor } from '../../../app/map-layers.svelte';
import type { GeoPosition } from '../../../vehicle/geo';
import type { Problem } from '../../../api/problems';
import type { GeneratedPattern, PlanApi } from '../api';
import { startOf, kindOf, type PlanKind } from '../document-kinds';
import { isPatternItem, type Pattern, type PatternItem } from '../document/document';
import { setItem, takeApart } from '../document/edit';
import { isStale, ringsOf, withPattern } from '../document/pattern-items';
import type { PlanEditor } from '../editor/editor.svelte';
import type { FieldValue } from '../../../vehicle/fields';
import { patternLayer } from './pattern-layer';
import * as shape from './shape';
import { NO_RINGS, PATTERNS, type PatternKind, type Rings, type ShapePoint } from './shape';
import {
  cameraOf,
  DEFAULT_VALUES,
  problemPlaceOf,
  requestOf,
  valuesOf,
  withCamera,
  withRow,
  type FieldProblem,
  type PatternRequest,
  type PatternValues,
  type RowName,
} from './values';

type BrowserStorage = Pick<Storage, 'getItem' | 'setItem'>;
const CAMERA_STORAGE_KEY = 'gcs.pattern-camera';
/** Largest permitted deviation of the lines from their height above ground [m]. */
export const GROUND_TOLERANCE_M = 5;

interface PatternPreview {
  readonly requestKey: string;
  readonly generated: GeneratedPattern | null;
  readonly problem: FieldProblem | null;
}

export class PatternDrawing implements LayerEditor {
  /** Null: no pattern is being drawn. */
  kind = $state.raw<PatternKind | null>(null);
  /** The drawn shape. After a cancellation, the shape is kept for the next pattern. */
  rings = $state.raw<Rings>(NO_RINGS);
  /** The ring to which the next click adds a point. */
  private activeRing = $state(0);
  selected = $state.raw<ShapePoint | null>(null);
  values = $state.raw<PatternValues>(DEFAULT_VALUES);
  private preview = $state.raw<PatternPreview | null>(null);
  /** Whether a preview is being generated. */
  busy = $state(false);
  /** The vehicle whose parameters the server uses for the pattern; null: none. */
  vehicle = $state.raw<string | null>(null);
  private requestCount = 0;
  /** Row of the pattern of the plan that is edited; null: a new pattern is drawn. */
  editedRow = $state<number | null>(null);
  /** The values of the edited pattern as they are in the plan. */
  private editedPattern: Pattern | null = null;
  private gestureCount = 0;
  /** Shape and selection before the drag in progress. */
  private stateBeforeDrag: { rings: Rings; selected: ShapePoint | null } | null = null;

  constructor(
    private readonly api: PlanApi,
    private readonly editor: PlanEditor,
    private readonly storage: BrowserStorage,
  ) {
    this.values = withCamera(DEFAULT_VALUES, this.storedCamera());
  }

  readonly type = $derived(PATTERNS[this.kind ?? 'survey']);
  /** Number of points that the shape still needs. */
  readonly missingPointCount = $derived(shape.missingPoints(this.rings, this.type.shape));
  private readonly request: PatternRequest | null = $derived.by(() =>
    this.kind === null || this.missingPointCount > 0 ? null : requestOf(this.kind, this.rings, this.values),
  );
  private readonly documentKind: PlanKind = $derived.by(() => kindOf(this.editor.document));
  /** Identifies the request to the server; null: the shape is not complete, or a value is missing. */
  readonly requestKey: string | null = $derived.by(() =>
    this.request?.ok === true ? JSON.stringify([this.request.pattern, this.documentKind, this.vehicle]) : null,
  );
  /** Whether a preview or the items of the edited pattern are to be requested. */
  readonly needsRefresh: boolean = $derived.by(() => this.requestKey !== null && (!this.isCurrent || (this.edited !== null && isStale(this.edited))));
  readonly isCurrent: boolean = $derived(this.requestKey !== null && this.preview?.requestKey === this.requestKey);
  /** The newest generated pattern; while `isCurrent` is false, it belongs to an earlier shape or setting. */
  readonly generated: GeneratedPattern | null = $derived.by(() => (this.requestKey === null ? null : (this.preview?.generated ?? null)));
  readonly problem: FieldProblem | null = $derived.by(() =>
    this.request?.ok === false ? this.request.problem : this.isCurrent ? (this.preview?.problem ?? null) : null,
  );
  readonly content = $derived.by(() => {
    if (this.kind === null) return null;
    const radius_m = this.kind === 'orbit' ? this.values.radius_m : null;
    const start = startOf(this.editor.document, this.editor.frame, this.rings[0]?.[0]);
    return patternLayer(this.rings, this.type.shape, this.selected, this.generated, this.isCurrent, radius_m, start);
  });

  /** The pattern of the plan that is edited; null: a new pattern is drawn. */
  readonly edited: PatternItem | null = $derived.by(() => {
    const item = this.editedRow === null ? undefined : this.editor.plan.items[this.editedRow];
    return isPatternItem(item) ? item : null;
  });

  /** Begins to edit a pattern of the plan. */
  edit(row: number): void {
    const item = this.editor.plan.items[row];
    if (!isPatternItem(item)) return;
    this.editor.stopPlacing();
    this.editor.select([`item:${row}`]);
    this.editedRow = row;
    this.preview = null;
    this.load(item.pattern);
  }

  /** Takes over what undo or redo made of the edited pattern, and ends if it is no longer there. */
  sync(): void {
    if (this.editedRow === null) return;
    if (this.edited === null) this.cancel();
    else if (this.edited.pattern !== this.editedPattern) this.load(this.edited.pattern);
  }

  private load(pattern: Pattern): void {
    const selected = this.kind === pattern.kind ? this.selected : null;
    this.kind = pattern.kind;
    this.editedPattern = pattern;
    this.values = valuesOf(pattern, this.values);
    this.setRings(ringsOf(pattern));
    if (selected !== null && this.rings[selected.ring]?.[selected.index] !== undefined) this.selectPoint(selected);
  }

  /** Writes the shape and the settings into the edited pattern of the plan. @param group changes of one group are undone together. */
  private commit(group: string | null = null): void {
    const [item, row, request] = [this.edited, this.editedRow, this.request];
    if (item === null || row === null || request?.ok !== true) return;
    const pattern = { ...item.pattern, ...request.pattern } as Pattern;
    if (JSON.stringify(pattern) === JSON.stringify(item.pattern)) return;
    this.editedPattern = pattern;
    this.editor.change(setItem(this.editor.plan, row, withPattern(item, pattern)), group);
  }

  /** Replaces the edited pattern by its mission items. */
  takeApart(): void {
    if (this.editedRow === null) return;
    const row = this.editedRow;
    this.cancel();
    this.editor.changeAndDeselect(takeApart(this.editor.plan, row));
    this.editor.select([`item:${row}`]);
  }

  begin(kind: PatternKind): void {
    this.editor.stopPlacing();
    if (this.editedRow !== null) this.setRings(NO_RINGS);
    this.editedRow = null;
    this.kind = kind;
    this.setRings(shape.usableRings(this.rings, kind));
    this.preview = null;
  }

  /** Begins a survey of an area, which may have holes. */
  beginSurvey(outer: readonly GeoPosition[], holes: readonly (readonly GeoPosition[])[]): void {
    this.begin('survey');
    this.setRings([outer, ...holes]);
  }

  cancel(): void {
    if (this.editedRow !== null) {
      this.editedRow = null;
      this.editedPattern = null;
      this.setRings(NO_RINGS);
      this.editor.endGroup();
    }
    this.kind = null;
    this.preview = null;
  }

  /** Removes the drawn shape. */
  clear(): void {
    this.setRings(NO_RINGS);
  }

  set(name: RowName, value: FieldValue): void {
    this.values = withRow(this.values, name, value);
    if (this.values.has_camera) this.storage.setItem(CAMERA_STORAGE_KEY, JSON.stringify(cameraOf(this.values)));
    this.commit(`pattern ${name}`);
  }

  /** Replaces the shape by an area or a line. */
  replaceShape(points: readonly GeoPosition[]): void {
    this.setRings([points]);
    this.selected = points.length > 0 ? { ring: 0, index: 0 } : null;
    this.commit();
  }

  /** Begins a hole: the next points are its corners. */
  addHole(): void {
    this.rings = shape.addHole(this.rings);
    this.activeRing = this.rings.length - 1;
    this.selected = null;
  }

  get drawsHole(): boolean {
    return this.activeRing > 0;
  }

  selectPoint(point: ShapePoint): void {
    this.selected = point;
    this.activeRing = point.ring;
  }

  /** Position of the selected point. */
  readonly selectedPosition: GeoPosition | null = $derived.by(() =>
    this.selected === null ? null : (this.rings[this.selected.ring]?.[this.selected.index] ?? null),
  );

  /** Moves the selected point. */
  moveTo(position: GeoPosition): void {
    if (this.selected === null) return;
    this.rings = shape.movePoint(this.rings, this.selected, position);
    this.commit(this.stateBeforeDrag === null ? `pattern point ${shape.pointId(this.selected)}` : this.dragGroup);
  }

  press(position: GeoPosition): boolean {
    this.rings = shape.addPoint(this.rings, this.type.shape, this.activeRing, position);
    this.selected = { ring: this.activeRing, index: (this.rings[this.activeRing]?.length ?? 1) - 1 };
    this.commit();
    return true;
  }

  pick(id: string): void {
    const parsed = shape.pointOfId(id);
    if (parsed === null) return;
    if (parsed.isMidpoint) this.insertAt(id, parsed.point);
    this.selectPoint(parsed.point);
    this.commit();
  }

  private get dragGroup(): string {
    return `pattern drag ${this.gestureCount}`;
  }

  grab(id: string): string | null {
    const parsed = shape.pointOfId(id);
    if (parsed === null) return null;
    this.stateBeforeDrag = { rings: this.rings, selected: this.selected };
    this.gestureCount += 1;
    if (parsed.isMidpoint) this.insertAt(id, parsed.point);
    this.selectPoint(parsed.point);
    return shape.pointId(parsed.point);
  }

  drag(_id: string, to: GeoPosition): void {
    this.moveTo(to);
  }

  /** Does nothing: the points of a shape have no altitude. */
  raise(): void {}

  drop(keep: boolean): void {
    if (!keep && this.stateBeforeDrag !== null) {
      this.rings = this.stateBeforeDrag.rings;
      this.selected = this.stateBeforeDrag.selected;
      this.commit(this.dragGroup);
    }
    this.stateBeforeDrag = null;
    this.editor.endGroup();
  }

  remove(): boolean {
    const point = this.selected;
    if (point === null) return false;
    this.rings = shape.removePoint(this.rings, point);
    this.activeRing = Math.min(this.activeRing, this.rings.length - 1);
    const remainingCount = this.rings[point.ring]?.length ?? 0;
    this.selected = remainingCount === 0 ? null : { ring: point.ring, index: Math.max(0, point.index - 1) };
    this.commit();
    return true;
  }

  /** Requests the pattern from the server. The response to an earlier request is discarded. */
  async refresh(): Promise<void> {
    const [requestKey, kind, request] = [this.requestKey, this.kind, this.request];
    if (requestKey === null || kind === null || request?.ok !== true) return;
    if (this.isCurrent) return this.completeEdited();
    this.requestCount += 1;
    const requestNumber = this.requestCount;
    this.busy = true;
    const tolerance_m = this.values.reference === 'terrain' ? GROUND_TOLERANCE_M : null;
    const response = await this.api.pattern(request.pattern, this.documentKind, this.vehicle, tolerance_m);
    if (requestNumber === this.requestCount) this.busy = false;
    if (requestKey !== this.requestKey) return;
    if (response.ok) {
      this.preview = { requestKey, generated: response.value, problem: null };
      this.completeEdited();
    } else {
      this.preview = {
        requestKey,
        generated: null,
        problem: { place: problemPlaceOf(kind, response.problem.field), text: fieldProblemText(response.problem) },
      };
    }
  }

  /** Puts the items of the preview into the edited pattern, unless it has the items of its values already. */
  private completeEdited(): void {
    if (this.edited !== null && isStale(this.edited) && this.generated !== null) this.editor.completePattern(this.edited, this.generated.plan);
  }

  /** Inserts the pattern into the plan as one change. @returns null: the pattern was not generated, see `problem`. */
  async insert(): Promise<GeneratedPattern | null> {
    await this.refresh();
    const generated = this.isCurrent ? this.generated : null;
    if (generated === null) return null;
    this.editor.insertPattern(generated.plan);
    this.cancel();
    this.clear();
    return generated;
  }

  private setRings(rings: Rings): void {
    this.rings = rings;
    this.activeRing = 0;
    this.selected = null;
  }

  private insertAt(id: string, point: ShapePoint): void {
    const position = shape.midpoints(this.rings, this.type.shape).find((midpoint) => midpoint.id === id)?.position;
    if (position !== undefined) this.rings = shape.insertPoint(this.rings, point, position);
  }

  private storedCamera(): unknown {
    try {
      return JSON.parse(this.storage.getItem(CAMERA_STORAGE_KEY) ?? 'null');
    } catch {
      return null;
    }
  }
}

/** The server's reason and remedy, without the name of the field, because the text is shown beside the field. */
export function fieldProblemText({ code, detail, remedy, field }: Problem): string {
  if (code === 'unreachable') return 'The server did not answer. Is it still running?';
  const reason = detail.replace(`${field ?? ''}: `, '').replace(/^field /, '');
  return [reason.charAt(0).toUpperCase() + reason.slice(1), remedy ?? ''].join(' ').trim();
}
