/** The faces of solids with vertical sides in the 3D view, in the order in which they are drawn. Pure functions. */

import type { LayerSolid, Tone } from '../../app/map-layers.svelte';
import type { SceneView, Vector } from './scene-view';

export interface Face {
  /** Corners in the world's ENU [m]. */
  readonly ring: readonly Vector[];
  /** Lines to draw. A round solid, such as a mast, has vertical edges only where a visible side meets a hidden side. */
  readonly edges: readonly (readonly Vector[])[];
  readonly tone: Tone;
  /** Whether the outer side faces the camera. */
  readonly facesCamera: boolean;
  /** Opacity; it depends on the direction of the face, so that adjacent faces differ. */
  readonly shade: number;
}

/** Solids lower than this [m] have no faces: only their area on the ground is drawn. */
const MIN_HEIGHT_M = 0.05;
const TOP_SHADE = 0.34;
/** Adjacent sides whose directions differ by less than 40° have no edge between them (cosine of 40°). */
const ROUND_COS = 0.77;
/** Opacity of a side that faces south-west, and the additional opacity of a side that faces north-east. */
const [SIDE_SHADE, SIDE_CONTRAST] = [0.16, 0.14];

/** The faces of all solids, the farthest solid first; of each solid, first the faces that the camera does not see. */
export function facesOf(view: SceneView, solids: readonly LayerSolid[]): Face[] {
  return solids
    .map((solid) => ({ solid, base: solid.ring.map((at) => view.enuOf({ lat_deg: at.lat_deg, lon_deg: at.lon_deg })), top_m: view.upOf(solid.top_amsl_m) }))
    .filter(({ base, top_m }) => base.length > 2 && base.some(([, , up_m]) => top_m - up_m >= MIN_HEIGHT_M))
    .map((solid) => ({ ...solid, distance_m: Math.min(...solid.base.map((at) => Math.hypot(at[0] - view.eye[0], at[1] - view.eye[1]))) }))
    .sort((a, b) => b.distance_m - a.distance_m)
    .flatMap(({ solid, base, top_m }) => solidFaces(view, base, top_m, solid.tone));
}

/** @param base the corners on the ground, which the lower edges of the sides follow; nothing is drawn of what the ground covers. */
function solidFaces(view: SceneView, base: readonly Vector[], top_m: number, tone: Tone): Face[] {
  const { eye } = view;
  const orientation = Math.sign(doubleArea(base));
  const topRing = base.map(([east, north]): Vector => [east, north, top_m]);
  const sideShapes = base.map((a, i) => {
    const next = (i + 1) % base.length;
    const [b, c, d] = [base[next] ?? a, topRing[next] ?? a, topRing[i] ?? a];
    const foot = view.onGround([a, b]).map(([x, y, up_m]): Vector => [x, y, Math.min(up_m, top_m)]);
    // Horizontal direction out of the solid.
    const [east, north] = [orientation * (b[1] - a[1]), -orientation * (b[0] - a[0])];
    const length = Math.hypot(east, north) || 1;
    const facesCamera = east * (eye[0] - a[0]) + north * (eye[1] - a[1]) > 0;
    return { foot, top: [c, d] as const, normal: [east / length, north / length] as const, facesCamera };
  });
  const sides = sideShapes.map(({ foot, top: [c, d], normal, facesCamera }, i): Face => {
    const hasEdge = (other: (typeof sideShapes)[number] | undefined): boolean =>
      other === undefined || other.facesCamera !== facesCamera || normal[0] * other.normal[0] + normal[1] * other.normal[1] < ROUND_COS;
    const edges: (readonly Vector[])[] = [foot, [c, d]];
    if (hasEdge(sideShapes[(i + sideShapes.length - 1) % sideShapes.length])) edges.push([d, foot[0] ?? d]);
    if (hasEdge(sideShapes[(i + 1) % sideShapes.length])) edges.push([foot.at(-1) ?? c, c]);
    return { ring: [...foot, c, d], edges, tone, facesCamera, shade: SIDE_SHADE + (SIDE_CONTRAST * (1 + (normal[0] + normal[1]) / Math.SQRT2)) / 2 };
  });
  const top: Face = { ring: topRing, edges: [], tone, facesCamera: eye[2] > top_m, shade: TOP_SHADE };
  return [...sides, top].sort((a, b) => Number(a.facesCamera) - Number(b.facesCamera));
}

/** Twice the area of a ring; negative: clockwise. */
function doubleArea(ring: readonly Vector[]): number {
  return ring.reduce((sum, a, i) => {
    const b = ring[(i + 1) % ring.length] ?? a;
    return sum + a[0] * b[1] - b[0] * a[1];
  }, 0);
}
