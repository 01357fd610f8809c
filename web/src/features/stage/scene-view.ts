/** Converts between positions of a layer and pixels of the 3D view, with the matrices of the camera. Pure functions. */

import type { LayerPoint, LayerPosition } from '../../app/map-layers.svelte';
import { eastNorth, positionAt, type GeoPosition, type Pixel } from '../../vehicle/geo';
import type { LayerView } from './layer-gesture';
import type { SceneTerrain } from './scene-terrain';

/** A 4×4 matrix in column-major order, as in three.js. */
export type Matrix = ArrayLike<number>;
export type Vector = readonly [number, number, number];
/**
 * Clip coordinates (x, y, z, w); x/w and y/w are between −1 and 1 inside the view, w is the distance from the camera in
 * its viewing direction [m].
 */
export type Clip = readonly [number, number, number, number];

/** The camera of viser's page. */
export interface SceneCamera {
  readonly projection: Matrix;
  readonly projectionInverse: Matrix;
  /** Pose of the camera in viser's scene. */
  readonly pose: Matrix;
  readonly poseInverse: Matrix;
  /** Pose of the world (viser's node `/world`, with ENU axes) in viser's scene; some camera modes move this node. */
  readonly world: Matrix;
  /** Origin of the world's ENU frame. */
  readonly origin: Required<LayerPosition>;
  /** Size of the view [px]. */
  readonly width: number;
  readonly height: number;
}

/** Positions nearer to the camera are not drawn [m]. */
export const NEAR_M = 0.1;
/**
 * A pointer cannot select or move positions farther away than this [m], because a pixel then covers a large distance.
 */
const MAX_DISTANCE_M = 5000;
/** Distance between two points of a line on the ground [m], and their largest number for one leg. */
const GROUND_STEP_M = 10;
const MAX_GROUND_POINTS = 200;
/** Length of the line from a point to its handle [px]. */
const HANDLE_PX = 40;
/** Below this angle between the line of sight and the horizontal, a point is dragged on a vertical plane, not a horizontal one. */
const LOW_ANGLE_RAD = 0.07;
/** Smallest elevation angle of the camera in the overview. */
const MIN_ELEVATION_RAD = 0.5;
/** Smallest radius that the overview shows, so that a single position is shown with its surroundings [m]. */
const MIN_RADIUS_M = 12;
/** Below this angle between the line of sight and the vertical, a point has no handle; a drag of the handle works down to half the angle. */
const STEEP_ANGLE_RAD = 0.18;

const transform = (m: Matrix, [x, y, z, w]: Clip): Clip => {
  const row = (r: number): number => (m[r] ?? 0) * x + (m[r + 4] ?? 0) * y + (m[r + 8] ?? 0) * z + (m[r + 12] ?? 0) * w;
  return [row(0), row(1), row(2), row(3)];
};
const multiply = (a: Matrix, b: Matrix): Matrix => [0, 4, 8, 12].flatMap((c) => transform(a, [b[c] ?? 0, b[c + 1] ?? 0, b[c + 2] ?? 0, b[c + 3] ?? 0]));
const subtract = (a: Vector, b: Vector): Vector => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

function normalize(v: Vector): Vector {
  const length = Math.hypot(...v) || 1;
  return [v[0] / length, v[1] / length, v[2] / length];
}

export class SceneView implements LayerView {
  readonly width: number;
  readonly height: number;
  /** Position of the camera in the world's ENU [m]. */
  readonly eye: Vector;
  private readonly clipMatrix: Matrix;

  /**
   * @param ground_amsl_m altitude of level ground.
   * @param terrain the ground that the view draws; null: level ground.
   */
  constructor(
    private readonly camera: SceneCamera,
    private readonly ground_amsl_m: number,
    private readonly terrain: SceneTerrain | null = null,
  ) {
    this.width = camera.width;
    this.height = camera.height;
    this.clipMatrix = multiply(camera.projection, multiply(camera.poseInverse, camera.world));
    this.eye = this.toWorld([camera.pose[12] ?? 0, camera.pose[13] ?? 0, camera.pose[14] ?? 0]);
  }

  /** Converts a position to the world's ENU [m]; a position without an altitude is on the ground. */
  enuOf(at: LayerPosition): Vector {
    const { east_m, north_m } = eastNorth(this.camera.origin, at);
    return [east_m, north_m, at.alt_amsl_m === undefined ? this.groundUpAt(east_m, north_m) : this.upOf(at.alt_amsl_m)];
  }

  /** Up coordinate of the ground at a place in the world's ENU [m]. */
  groundUpAt(east_m: number, north_m: number): number {
    return this.terrain?.upAt(east_m, north_m) ?? this.ground_m;
  }

  /** The line on the ground below positions of the world's ENU, with points where the ground may bend. */
  onGround(line: readonly Vector[]): Vector[] {
    return line.flatMap((to, i) => {
      const from = this.terrain === null ? to : (line[i - 1] ?? to);
      const count = Math.min(MAX_GROUND_POINTS, Math.max(1, Math.ceil(Math.hypot(to[0] - from[0], to[1] - from[1]) / GROUND_STEP_M)));
      return Array.from({ length: count }, (_, k): Vector => {
        const fraction = (k + 1) / count;
        const [east, north] = [from[0] + (to[0] - from[0]) * fraction, from[1] + (to[1] - from[1]) * fraction];
        return [east, north, this.groundUpAt(east, north)];
      });
    });
  }

  /** Converts an altitude to an up coordinate in the world's ENU [m]. */
  upOf(alt_amsl_m: number): number {
    return alt_amsl_m - this.camera.origin.alt_amsl_m;
  }

  /** Up coordinate of the ground in the world's ENU [m]. */
  get ground_m(): number {
    return this.upOf(this.ground_amsl_m);
  }

  clipOf(enu: Vector): Clip {
    return transform(this.clipMatrix, [...enu, 1]);
  }

  /** Pixel of a position in front of the camera. */
  pixelOfClip([x, y, , w]: Clip): Pixel {
    return { x: ((x / w + 1) / 2) * this.width, y: ((1 - y / w) / 2) * this.height };
  }

  readonly pixelOf = (at: LayerPosition): Pixel | null => {
    const clip = this.clipOf(this.enuOf(at));
    return clip[3] < NEAR_M ? null : this.pixelOfClip(clip);
  };

  readonly positionAt = (at: Pixel, reference: LayerPosition): GeoPosition | null => {
    const point = this.enuOf(reference);
    const sight = normalize(subtract(point, this.eye));
    return this.geoPosition(
      Math.abs(Math.asin(sight[2])) < LOW_ANGLE_RAD ? this.pointOnVerticalPlane(at, point, sight) : this.pointOnHorizontalPlane(at, point[2]),
    );
  };

  /** The ground position at a pixel; null: the sky, or too far away. */
  groundAt(at: Pixel): GeoPosition | null {
    const ray = this.rayOf(at);
    for (let distance_m = 1, before_m = 0; this.terrain !== null && distance_m < MAX_DISTANCE_M; distance_m += Math.max(1, distance_m / 100)) {
      const [east, north, up] = this.alongRay(ray, distance_m);
      if (up <= (this.terrain.upAt(east, north) ?? -Infinity)) return this.geoPosition(this.alongRay(ray, (before_m + distance_m) / 2));
      before_m = distance_m;
    }
    return this.geoPosition(this.pointOnHorizontalPlane(at, this.ground_m));
  }

  private alongRay(ray: Vector, distance_m: number): Vector {
    return [this.eye[0] + ray[0] * distance_m, this.eye[1] + ray[1] * distance_m, this.eye[2] + ray[2] * distance_m];
  }

  readonly heightAt = (at: Pixel, position: LayerPosition): number | null => {
    const [ray, toEye] = [this.rayOf(at), subtract(this.eye, this.enuOf(position))];
    const horizontalSquared = 1 - ray[2] * ray[2];
    if (horizontalSquared < Math.sin(STEEP_ANGLE_RAD / 2) ** 2) return null;
    // The point on the vertical line nearest to the ray; it must be in front of the camera.
    const height_m = (toEye[2] - ray[2] * dot(toEye, ray)) / horizontalSquared;
    return height_m * ray[2] - dot(toEye, ray) > 0 && Math.abs(height_m) < MAX_DISTANCE_M ? height_m : null;
  };

  readonly handleOf = (point: LayerPoint): Pixel | null => {
    const enu = this.enuOf(point);
    const clips = [this.clipOf(enu), this.clipOf([enu[0], enu[1], enu[2] + 0.1])] as const;
    const isSteep = Math.abs(normalize(subtract(enu, this.eye))[2]) > Math.cos(STEEP_ANGLE_RAD);
    if (isSteep || clips.some((clip) => clip[3] < NEAR_M)) return null;
    const [at, abovePixel] = [this.pixelOfClip(clips[0]), this.pixelOfClip(clips[1])];
    const length = Math.hypot(abovePixel.x - at.x, abovePixel.y - at.y);
    return length === 0 ? null : { x: at.x + ((abovePixel.x - at.x) / length) * HANDLE_PX, y: at.y + ((abovePixel.y - at.y) / length) * HANDLE_PX };
  };

  /**
   * The pose from which the camera shows all positions from above, with the camera's current bearing.
   * @param freeFraction the smaller side of the area that no panel covers, as a fraction of the view's height.
   * @returns position and target of the camera in viser's scene; null: there are no positions.
   */
  overviewPose(positions: readonly LayerPosition[], fov_rad: number, freeFraction: number): { eye: Vector; target: Vector } | null {
    if (positions.length === 0) return null;
    const points = positions.map((at) => this.enuOf(at));
    const maximum = (valueOf: (at: Vector) => number): number => points.reduce((max, at) => Math.max(max, valueOf(at)), -Infinity);
    const middle = (axis: 0 | 1 | 2): number => (maximum((at) => at[axis]) - maximum((at) => -at[axis])) / 2;
    const target: Vector = [middle(0), middle(1), middle(2)];
    const radius_m = Math.max(
      MIN_RADIUS_M,
      maximum((at) => Math.hypot(...subtract(at, target))),
    );
    const distance_m = (radius_m * 1.2) / (Math.tan(fov_rad / 2) * Math.max(0.1, freeFraction));
    const direction = this.viewDirection();
    const elevation = Math.min(Math.PI / 2 - 0.01, Math.max(MIN_ELEVATION_RAD, Math.asin(-direction[2])));
    const bearing = Math.atan2(direction[0], direction[1]);
    const horizontal_m = distance_m * Math.cos(elevation);
    const eye: Vector = [
      target[0] - horizontal_m * Math.sin(bearing),
      target[1] - horizontal_m * Math.cos(bearing),
      target[2] + distance_m * Math.sin(elevation),
    ];
    return { eye: this.toScene(eye), target: this.toScene(target) };
  }

  /** Converts a point from the world's ENU to the coordinates of viser's scene. */
  private toScene(enu: Vector): Vector {
    const [x, y, z] = transform(this.camera.world, [...enu, 1]);
    return [x, y, z];
  }

  /** The direction in which the camera looks, in the world's ENU. */
  private viewDirection(): Vector {
    const { pose } = this.camera;
    const pointAhead: Vector = [(pose[12] ?? 0) - (pose[8] ?? 0), (pose[13] ?? 0) - (pose[9] ?? 0), (pose[14] ?? 0) - (pose[10] ?? 0)];
    return normalize(subtract(this.toWorld(pointAhead), this.eye));
  }

  /** Direction from the camera through a pixel, in the world's ENU. */
  private rayOf(at: Pixel): Vector {
    const local = transform(this.camera.projectionInverse, [(2 * at.x) / this.width - 1, 1 - (2 * at.y) / this.height, 0.5, 1]);
    const [x, y, z] = transform(this.camera.pose, [local[0] / local[3], local[1] / local[3], local[2] / local[3], 1]);
    return normalize(subtract(this.toWorld([x, y, z]), this.eye));
  }

  /** Converts a point from the coordinates of viser's scene to the world's ENU. The world is moved and rotated in the scene, but not scaled. */
  private toWorld(at: Vector): Vector {
    const m = this.camera.world;
    const offset = subtract(at, [m[12] ?? 0, m[13] ?? 0, m[14] ?? 0]);
    const axis = (c: number): number => dot([m[c] ?? 0, m[c + 1] ?? 0, m[c + 2] ?? 0], offset);
    return [axis(0), axis(4), axis(8)];
  }

  /** Converts a point from the world's ENU to a geographic position; null: no point, or farther away than `MAX_DISTANCE_M`. */
  private geoPosition(enu: Vector | null): GeoPosition | null {
    if (enu === null || Math.hypot(enu[0] - this.eye[0], enu[1] - this.eye[1]) > MAX_DISTANCE_M) return null;
    return positionAt(this.camera.origin, { east_m: enu[0], north_m: enu[1] });
  }

  /** The point at a distance from the camera along a ray; null: behind the camera. */
  private pointOnRay(ray: Vector, length_m: number): Vector | null {
    if (!(length_m > 0) || !Number.isFinite(length_m)) return null;
    return [this.eye[0] + ray[0] * length_m, this.eye[1] + ray[1] * length_m, this.eye[2] + ray[2] * length_m];
  }

  /** The point at a pixel on the horizontal plane with this up coordinate. */
  private pointOnHorizontalPlane(at: Pixel, up_m: number): Vector | null {
    const ray = this.rayOf(at);
    return this.pointOnRay(ray, (up_m - this.eye[2]) / ray[2]);
  }

  /** The point at a pixel on the vertical plane that contains `point` and faces the camera. */
  private pointOnVerticalPlane(at: Pixel, point: Vector, sight: Vector): Vector | null {
    const [ray, planeNormal] = [this.rayOf(at), normalize([sight[0], sight[1], 0])];
    return this.pointOnRay(ray, dot(subtract(point, this.eye), planeNormal) / dot(ray, planeNormal));
  }
}

const isMatrix = (m: unknown): m is Matrix => {
  const list = m as ArrayLike<unknown> | null | undefined;
  return list != null && list.length === 16 && Array.from(list).every((value) => typeof value === 'number' && Number.isFinite(value));
};

/** Parses the world's origin, which viser's page contains as the text "lat_deg,lon_deg,alt_amsl_m". */
export function parseOrigin(text: string | undefined): Required<LayerPosition> | null {
  const [lat_deg, lon_deg, alt_amsl_m, extra] = (text ?? '').split(',').map((part) => (part.trim() === '' ? NaN : Number(part)));
  if (lat_deg === undefined || lon_deg === undefined || alt_amsl_m === undefined || extra !== undefined) return null;
  return [lat_deg, lon_deg, alt_amsl_m].every(Number.isFinite) ? { lat_deg, lon_deg, alt_amsl_m } : null;
}

/** The camera if its matrices are complete and finite; null otherwise, such as while viser starts. */
export function validCamera(camera: { readonly [name in keyof SceneCamera]: SceneCamera[name] | undefined }): SceneCamera | null {
  const { projection, projectionInverse, pose, poseInverse, world, origin, width, height } = camera;
  if (![projection, projectionInverse, pose, poseInverse, world].every(isMatrix)) return null;
  return origin === undefined || !width || !height ? null : (camera as SceneCamera);
}
