/** The pattern that is being drawn: its shape on the map, its settings, the server's preview, and the insertion. */

import type { LayerEditor } from '../../../app/map-layers.svelte';
import type { GeoPosition } from '../../../vehicle/geo';
import type { Problem } from '../../../api/problems';
import type { GeneratedPattern, PlanApi } from '../api';
import { startOf, kindOf, type PlanKind } from '../document-kinds';
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
  readonly isCurrent = $derived(this.requestKey !== null && this.preview?.requestKey === this.requestKey);
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

  begin(kind: PatternKind): void {
    this.editor.stopPlacing();
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
    this.kind = null;
    this.preview = null;
  }

  /** Removes the drawn shape. */
  clear(): void {
    this.setRings(NO_RINGS);
  }

  set(name: RowName, value: FieldValue): void {
    this.values = withRow(this.values, name, value);
    this.storage.setItem(CAMERA_STORAGE_KEY, JSON.stringify(cameraOf(this.values)));
  }

  /** Replaces the shape by an area or a line. */
  replaceShape(points: readonly GeoPosition[]): void {
    this.setRings([points]);
    this.selected = points.length > 0 ? { ring: 0, index: 0 } : null;
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
    if (this.selected !== null) this.rings = shape.movePoint(this.rings, this.selected, position);
  }

  press(position: GeoPosition): boolean {
    this.rings = shape.addPoint(this.rings, this.type.shape, this.activeRing, position);
    this.selected = { ring: this.activeRing, index: (this.rings[this.activeRing]?.length ?? 1) - 1 };
    return true;
  }

  pick(id: string): void {
    const parsed = shape.pointOfId(id);
    if (parsed === null) return;
    if (parsed.isMidpoint) this.insertAt(id, parsed.point);
    this.selectPoint(parsed.point);
  }

  grab(id: string): string | null {
    const parsed = shape.pointOfId(id);
    if (parsed === null) return null;
    this.stateBeforeDrag = { rings: this.rings, selected: this.selected };
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
    }
    this.stateBeforeDrag = null;
  }

  remove(): boolean {
    const point = this.selected;
    if (point === null) return false;
    this.rings = shape.removePoint(this.rings, point);
    this.activeRing = Math.min(this.activeRing, this.rings.length - 1);
    const remainingCount = this.rings[point.ring]?.length ?? 0;
    this.selected = remainingCount === 0 ? null : { ring: point.ring, index: Math.max(0, point.index - 1) };
    return true;
  }

  /** Requests the pattern from the server. The response to an earlier request is discarded. */
  async refresh(): Promise<void> {
    const [requestKey, kind, request] = [this.requestKey, this.kind, this.request];
    if (requestKey === null || kind === null || request?.ok !== true || this.isCurrent) return;
    this.requestCount += 1;
    const requestNumber = this.requestCount;
    this.busy = true;
    const tolerance_m = this.values.reference === 'terrain' ? GROUND_TOLERANCE_M : null;
    const response = await this.api.pattern(request.pattern, this.documentKind, this.vehicle, tolerance_m);
    if (requestNumber === this.requestCount) this.busy = false;
    if (requestKey !== this.requestKey) return;
    if (response.ok) this.preview = { requestKey, generated: response.value, problem: null };
    else {
      this.preview = {
        requestKey,
        generated: null,
        problem: { place: problemPlaceOf(kind, response.problem.field), text: fieldProblemText(response.problem) },
      };
    }
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
