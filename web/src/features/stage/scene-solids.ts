/** The faces of upright bodies in the 3D view, in the order in which they are drawn. Pure. */

import type { LayerSolid, Tone } from '../../app/map-layers.svelte';
import type { SceneView, Vector } from './scene-view';

export interface Face {
  /** Corners in the world's ENU [m]. */
  readonly ring: readonly Vector[];
  /** Edges to draw. A round body, such as a mast, has vertical edges only between a side in front and a side behind. */
  readonly edges: readonly (readonly [Vector, Vector])[];
  readonly tone: Tone;
  /** Whether the outer side faces the camera. */
  readonly facesCamera: boolean;
  /** Opacity; it depends on the direction of the face, so that adjacent faces differ. */
  readonly shade: number;
}

/** Lower bodies have no faces; only their area on the ground is drawn [m]. */
const MIN_HEIGHT_M = 0.05;
const TOP_SHADE = 0.34;
/** Sides that differ less in direction have no edge between them (cosine of 40°). */
const ROUND_COS = 0.77;
/** Opacity of a side that faces south-west, and the additional opacity of a side that faces north-east. */
const [SIDE_SHADE, SIDE_CONTRAST] = [0.16, 0.14];

/** The faces of all bodies, the farthest body first; of each body, first the faces behind, then the faces in front. */
export function facesOf(view: SceneView, solids: readonly LayerSolid[]): Face[] {
  return solids
    .map((solid) => ({ solid, base: solid.ring.map((at) => view.enuOf({ lat_deg: at.lat_deg, lon_deg: at.lon_deg })), top_m: view.upOf(solid.top_amsl_m) }))
    .filter(({ base, top_m }) => base.length > 2 && top_m - view.ground_m >= MIN_HEIGHT_M)
    .map((body) => ({ ...body, away_m: Math.min(...body.base.map((at) => Math.hypot(at[0] - view.eye[0], at[1] - view.eye[1]))) }))
    .sort((a, b) => b.away_m - a.away_m)
    .flatMap(({ solid, base, top_m }) => faces(base, top_m, solid.tone, view.eye));
}

function faces(base: readonly Vector[], top_m: number, tone: Tone, eye: Vector): Face[] {
  const orientation = Math.sign(area(base));
  const roof = base.map(([east, north]): Vector => [east, north, top_m]);
  const walls = base.map((a, i) => {
    const next = (i + 1) % base.length;
    const [b, c, d] = [base[next] ?? a, roof[next] ?? a, roof[i] ?? a];
    // Horizontal direction out of the body.
    const [east, north] = [orientation * (b[1] - a[1]), -orientation * (b[0] - a[0])];
    const length = Math.hypot(east, north) || 1;
    const facesCamera = east * (eye[0] - a[0]) + north * (eye[1] - a[1]) > 0;
    return { ring: [a, b, c, d] as const, out: [east / length, north / length] as const, facesCamera };
  });
  const sides = walls.map(({ ring, out, facesCamera }, i): Face => {
    const [a, b, c, d] = ring;
    const hasEdge = (other: (typeof walls)[number] | undefined): boolean =>
      other === undefined || other.facesCamera !== facesCamera || out[0] * other.out[0] + out[1] * other.out[1] < ROUND_COS;
    const edges = [[a, b] as const, [c, d] as const];
    if (hasEdge(walls[(i + walls.length - 1) % walls.length])) edges.push([d, a]);
    if (hasEdge(walls[(i + 1) % walls.length])) edges.push([b, c]);
    return { ring, edges, tone, facesCamera, shade: SIDE_SHADE + (SIDE_CONTRAST * (1 + (out[0] + out[1]) / Math.SQRT2)) / 2 };
  });
  const top: Face = { ring: roof, edges: [], tone, facesCamera: eye[2] > top_m, shade: TOP_SHADE };
  return [...sides, top].sort((a, b) => Number(a.facesCamera) - Number(b.facesCamera));
}

/** Twice the area of a ring; negative: clockwise. */
function area(ring: readonly Vector[]): number {
  return ring.reduce((sum, a, i) => {
    const b = ring[(i + 1) % ring.length] ?? a;
    return sum + a[0] * b[1] - b[0] * a[1];
  }, 0);
}
