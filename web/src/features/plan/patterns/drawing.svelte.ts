/** The pattern that is being drawn: its shape on the map, its settings, the server's preview, and the insertion. */

import type { LayerEditor } from '../../../app/map-layers.svelte';
import type { GeoPosition } from '../../../vehicle/geo';
import type { Problem } from '../../../api/problems';
import type { MadePattern, PlanApi } from '../api';
import { groundOf, kindOf, type PlanKind } from '../document-kinds';
import type { PlanEditor } from '../editor/editor.svelte';
import type { FieldValue } from '../offboard/fields';
import { shapePicture } from './pattern-layer';
import * as shape from './shape';
import { NO_RINGS, PATTERNS, type PatternKind, type Rings, type ShapePoint } from './shape';
import {
  cameraOf,
  DEFAULT_VALUES,
  placeOf,
  requestOf,
  withCamera,
  withRow,
  type FieldProblem,
  type PatternRequest,
  type PatternValues,
  type RowName,
} from './values';

type Memory = Pick<Storage, 'getItem' | 'setItem'>;
const STORED_CAMERA = 'gcs.pattern-camera';
/** Largest deviation of the lines from their height above the ground [m]. */
export const GROUND_TOLERANCE_M = 5;

interface Preview {
  readonly key: string;
  readonly made: MadePattern | null;
  readonly problem: FieldProblem | null;
}

export class PatternDrawing implements LayerEditor {
  /** Null: no pattern is being drawn. */
  kind = $state.raw<PatternKind | null>(null);
  /** Kept after a cancellation, so that the next pattern of the same area needs no new drawing. */
  rings = $state.raw<Rings>(NO_RINGS);
  /** The ring to which the next click adds a point. */
  private active = $state(0);
  selected = $state.raw<ShapePoint | null>(null);
  values = $state.raw<PatternValues>(DEFAULT_VALUES);
  private preview = $state.raw<Preview | null>(null);
  /** A preview is being generated. */
  busy = $state(false);
  /** The vehicle whose parameters are used; null: none. */
  vehicle = $state.raw<string | null>(null);
  private requests = 0;
  private grabbed: { rings: Rings; selected: ShapePoint | null } | null = null;

  constructor(
    private readonly api: PlanApi,
    private readonly editor: PlanEditor,
    private readonly memory: Memory,
  ) {
    this.values = withCamera(DEFAULT_VALUES, this.storedCamera());
  }

  readonly type = $derived(PATTERNS[this.kind ?? 'survey']);
  readonly missing = $derived(shape.missingPoints(this.rings, this.type.shape));
  private readonly request: PatternRequest | null = $derived.by(() =>
    this.kind === null || this.missing > 0 ? null : requestOf(this.kind, this.rings, this.values),
  );
  private readonly document: PlanKind = $derived.by(() => kindOf(this.editor.document));
  /** Identifies the request to the server; null: the shape is not complete, or a value is missing. */
  readonly key: string | null = $derived.by(() => (this.request?.ok === true ? JSON.stringify([this.request.pattern, this.document, this.vehicle]) : null));
  readonly isCurrent = $derived(this.key !== null && this.preview?.key === this.key);
  /** The generated pattern, of the present or an earlier shape. */
  readonly made: MadePattern | null = $derived.by(() => (this.key === null ? null : (this.preview?.made ?? null)));
  readonly problem: FieldProblem | null = $derived.by(() =>
    this.request?.ok === false ? this.request.problem : this.isCurrent ? (this.preview?.problem ?? null) : null,
  );
  readonly picture = $derived.by(() => {
    if (this.kind === null) return null;
    const radius_m = this.kind === 'orbit' ? this.values.radius_m : null;
    const ground = groundOf(this.editor.document, this.editor.frame, this.rings[0]?.[0]);
    return shapePicture(this.rings, this.type.shape, this.selected, this.made, this.isCurrent, radius_m, ground);
  });

  begin(kind: PatternKind): void {
    this.editor.stopPlacing();
    this.kind = kind;
    this.setRings(shape.fitting(this.rings, kind));
    this.preview = null;
  }

  cancel(): void {
    this.kind = null;
    this.preview = null;
  }

  /** Removes what is drawn. */
  clear(): void {
    this.setRings(NO_RINGS);
  }

  set(name: RowName, value: FieldValue): void {
    this.values = withRow(this.values, name, value);
    this.memory.setItem(STORED_CAMERA, JSON.stringify(cameraOf(this.values)));
  }

  /** Draws an area or a line as a whole. */
  draw(points: readonly GeoPosition[]): void {
    this.setRings([points]);
    this.selected = points.length > 0 ? { ring: 0, index: 0 } : null;
  }

  /** Begins a hole: the next points are its corners. */
  addHole(): void {
    this.rings = shape.addHole(this.rings);
    this.active = this.rings.length - 1;
    this.selected = null;
  }

  get drawsHole(): boolean {
    return this.active > 0;
  }

  choose(point: ShapePoint): void {
    this.selected = point;
    this.active = point.ring;
  }

  readonly at: GeoPosition | null = $derived.by(() => (this.selected === null ? null : (this.rings[this.selected.ring]?.[this.selected.index] ?? null)));

  /** Moves the selected point. */
  moveTo(at: GeoPosition): void {
    if (this.selected !== null) this.rings = shape.movePoint(this.rings, this.selected, at);
  }

  press(at: GeoPosition): boolean {
    this.rings = shape.addPoint(this.rings, this.type.shape, this.active, at);
    this.selected = { ring: this.active, index: (this.rings[this.active]?.length ?? 1) - 1 };
    return true;
  }

  pick(id: string): void {
    const found = shape.pointOfId(id);
    if (found === null) return;
    if (found.inserts) this.insertAt(id, found.point);
    this.choose(found.point);
  }

  grab(id: string): string | null {
    const found = shape.pointOfId(id);
    if (found === null) return null;
    this.grabbed = { rings: this.rings, selected: this.selected };
    if (found.inserts) this.insertAt(id, found.point);
    this.choose(found.point);
    return shape.pointId(found.point);
  }

  drag(_id: string, to: GeoPosition): void {
    this.moveTo(to);
  }

  /** Corners have no height. */
  raise(): void {}

  drop(keep: boolean): void {
    if (!keep && this.grabbed !== null) {
      this.rings = this.grabbed.rings;
      this.selected = this.grabbed.selected;
    }
    this.grabbed = null;
  }

  remove(): boolean {
    const point = this.selected;
    if (point === null) return false;
    this.rings = shape.removePoint(this.rings, point);
    this.active = Math.min(this.active, this.rings.length - 1);
    const left = this.rings[point.ring]?.length ?? 0;
    this.selected = left === 0 ? null : { ring: point.ring, index: Math.max(0, point.index - 1) };
    return true;
  }

  /** Requests the present pattern from the server. The answer to an earlier request is discarded. */
  async refresh(): Promise<void> {
    const [key, kind, request] = [this.key, this.kind, this.request];
    if (key === null || kind === null || request?.ok !== true || this.isCurrent) return;
    this.requests += 1;
    const number = this.requests;
    this.busy = true;
    const tolerance_m = this.values.reference === 'terrain' ? GROUND_TOLERANCE_M : null;
    const answer = await this.api.pattern(request.pattern, this.document, this.vehicle, tolerance_m);
    if (number === this.requests) this.busy = false;
    if (key !== this.key) return;
    if (answer.ok) this.preview = { key, made: answer.value, problem: null };
    else {
      this.preview = { key, made: null, problem: { place: placeOf(kind, answer.problem.field), text: fieldProblemText(answer.problem) } };
    }
  }

  /** Inserts the pattern into the plan as one change. @returns null: it cannot be generated, see `problem`. */
  async insert(): Promise<MadePattern | null> {
    await this.refresh();
    const made = this.isCurrent ? this.made : null;
    if (made === null) return null;
    this.editor.insertPattern(made.plan);
    this.cancel();
    this.clear();
    return made;
  }

  private setRings(rings: Rings): void {
    this.rings = rings;
    this.active = 0;
    this.selected = null;
  }

  private insertAt(id: string, point: ShapePoint): void {
    const at = shape.midpoints(this.rings, this.type.shape).find((one) => one.id === id)?.at;
    if (at !== undefined) this.rings = shape.insertPoint(this.rings, point, at);
  }

  private storedCamera(): unknown {
    try {
      return JSON.parse(this.memory.getItem(STORED_CAMERA) ?? 'null');
    } catch {
      return null;
    }
  }
}

/** The server's reason and remedy, without the name of the field: the text is shown beside the field. */
export function fieldProblemText({ code, detail, remedy, field }: Problem): string {
  if (code === 'unreachable') return 'The server did not answer. Is it still running?';
  const reason = detail.replace(`${field ?? ''}: `, '').replace(/^field /, '');
  return [reason.charAt(0).toUpperCase() + reason.slice(1), remedy ?? ''].join(' ').trim();
}
