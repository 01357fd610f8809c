/** The faces of upright bodies in the 3D view, in the order in which they are drawn. Pure. */

import type { LayerSolid, Tone } from '../../app/map-layers.svelte';
import type { SceneView, Vector } from './scene-view';

export interface Face {
  /** Corners in the world's ENU [m]. */
  readonly ring: readonly Vector[];
  readonly tone: Tone;
  /** Whether its outer side is towards the camera. */
  readonly inFront: boolean;
  /** Opacity of its outer side: sides in different directions differ, so that their edges are visible. */
  readonly shade: number;
}

/** Lower bodies are drawn only as the area on the ground [m]. */
const LEAST_HEIGHT_M = 0.05;
const TOP_SHADE = 0.34;
/** Opacity of the side towards south-west, and what a side towards north-east has more. */
const [SIDE_SHADE, SIDE_CONTRAST] = [0.16, 0.14];

/** The faces of all bodies: the farthest body first, of each body the faces behind it, then those in front. */
export function facesOf(view: SceneView, solids: readonly LayerSolid[]): Face[] {
  return solids
    .map((solid) => ({ solid, base: solid.ring.map((at) => view.enuOf({ lat_deg: at.lat_deg, lon_deg: at.lon_deg })), top_m: view.upOf(solid.top_amsl_m) }))
    .filter(({ base, top_m }) => base.length > 2 && top_m - view.ground_m >= LEAST_HEIGHT_M)
    .map((one) => ({ ...one, away_m: Math.min(...one.base.map((at) => Math.hypot(at[0] - view.eye[0], at[1] - view.eye[1]))) }))
    .sort((a, b) => b.away_m - a.away_m)
    .flatMap(({ solid, base, top_m }) => faces(base, top_m, solid.tone, view.eye));
}

function faces(base: readonly Vector[], top_m: number, tone: Tone, eye: Vector): Face[] {
  const turn = Math.sign(area(base));
  const sides = base.map((a, i): Face => {
    const b = base[(i + 1) % base.length] ?? a;
    // Horizontal direction out of the body.
    const [east, north] = [turn * (b[1] - a[1]), -turn * (b[0] - a[0])];
    const length = Math.hypot(east, north) || 1;
    return {
      ring: [a, b, [b[0], b[1], top_m], [a[0], a[1], top_m]],
      tone,
      inFront: east * (eye[0] - a[0]) + north * (eye[1] - a[1]) > 0,
      shade: SIDE_SHADE + (SIDE_CONTRAST * (1 + (east + north) / length / Math.SQRT2)) / 2,
    };
  });
  const top: Face = { ring: base.map(([east, north]): Vector => [east, north, top_m]), tone, inFront: eye[2] > top_m, shade: TOP_SHADE };
  return [...sides, top].sort((a, b) => Number(a.inFront) - Number(b.inFront));
}

/** Twice the area of a ring; negative: clockwise. */
function area(ring: readonly Vector[]): number {
  return ring.reduce((sum, a, i) => {
    const b = ring[(i + 1) % ring.length] ?? a;
    return sum + a[0] * b[1] - b[0] * a[1];
  }, 0);
}
