/** Access to the camera of viser's page, which is in the iframe of the 3D view. Only this file uses viser's names. */

import type { LayerPosition } from '../../app/map-layers.svelte';
import type { CameraPose } from './scene-overview';
import { SceneTerrain } from './scene-terrain';
import { parseOrigin, validCamera, type Matrix, type SceneCamera } from './scene-view';

interface Elements {
  readonly elements: Matrix;
}

interface SceneNode {
  readonly matrixWorld: Elements;
  readonly geometry?: { readonly attributes?: { readonly position?: { readonly array: ArrayLike<number> } } };
  readonly traverse?: (visit: (node: SceneNode) => void) => void;
}

interface ViserState {
  readonly camera?: {
    readonly fov: number;
    readonly projectionMatrix: Elements;
    readonly projectionMatrixInverse: Elements;
    readonly matrixWorld: Elements;
    readonly matrixWorldInverse: Elements;
  } | null;
  readonly nodeRefFromName?: Readonly<Record<string, SceneNode | undefined>>;
  readonly cameraControl?: {
    readonly setLookAt: (...numbers: number[]) => unknown;
    readonly getTarget: () => Readonly<Record<'x' | 'y' | 'z', number>>;
    readonly getPosition: () => Readonly<Record<'x' | 'y' | 'z', number>>;
  } | null;
  readonly requestRender?: () => void;
}

export interface SceneWindow extends Window {
  readonly __viserMutable?: ViserState;
}

/**
 * The current camera; null while viser starts or reconnects.
 * @param origin origin of the world's ENU frame while no vehicle has reported a position.
 */
export function cameraOf(sceneWindow: SceneWindow, origin: Required<LayerPosition>): SceneCamera | null {
  const { camera, nodeRefFromName } = sceneWindow.__viserMutable ?? {};
  return validCamera({
    projection: camera?.projectionMatrix.elements,
    projectionInverse: camera?.projectionMatrixInverse.elements,
    pose: camera?.matrixWorld.elements,
    poseInverse: camera?.matrixWorldInverse.elements,
    world: nodeRefFromName?.['/world']?.matrixWorld.elements,
    origin: parseOrigin(sceneWindow.document.documentElement.dataset['gcsOrigin']) ?? origin,
    width: sceneWindow.innerWidth,
    height: sceneWindow.innerHeight,
  });
}

const TERRAIN = /^\/world\/terrain_\d+\/ground$/;
const terrains = new WeakMap<ArrayLike<number>, SceneTerrain>();

/** The ground that the view draws, the same object until it draws another one; null: a level grid. */
export function terrainOf(sceneWindow: SceneWindow): SceneTerrain | null {
  const nodes = sceneWindow.__viserMutable?.nodeRefFromName ?? {};
  const name = Object.keys(nodes)
    .filter((each) => TERRAIN.test(each) && nodes[each] != null)
    .at(-1);
  let vertices: ArrayLike<number> | null = null;
  nodes[name ?? '']?.traverse?.((node) => (vertices ??= node.geometry?.attributes?.position?.array ?? null));
  if (vertices === null) return null;
  const terrain = terrains.get(vertices) ?? new SceneTerrain(vertices);
  terrains.set(vertices, terrain);
  return terrain;
}

/** Vertical field of view of the camera [rad]; null while viser starts. */
export function fovOf(sceneWindow: SceneWindow): number | null {
  const fov_deg = sceneWindow.__viserMutable?.camera?.fov;
  return typeof fov_deg === 'number' && fov_deg > 0 ? (fov_deg * Math.PI) / 180 : null;
}

/** The newest pose of the camera, even if it was not drawn yet; null while viser starts. */
export function poseOf(sceneWindow: SceneWindow): CameraPose | null {
  const control = sceneWindow.__viserMutable?.cameraControl;
  if (control == null) return null;
  const [eye, target] = [control.getPosition(), control.getTarget()];
  return { eye: [eye.x, eye.y, eye.z], target: [target.x, target.y, target.z] };
}

/** Moves the camera. */
export function setPose(sceneWindow: SceneWindow, { eye, target }: CameraPose): void {
  const viser = sceneWindow.__viserMutable;
  void viser?.cameraControl?.setLookAt(...eye, ...target, 0); // 0: without a transition
  viser?.requestRender?.();
}
