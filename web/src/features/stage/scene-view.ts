/** Converts between positions of a layer and pixels of the 3D view, by the matrices of its camera. Pure. */

import type { LayerPoint, LayerPosition } from '../../app/map-layers.svelte';
import { eastNorth, positionAt, type GeoPosition, type Pixel } from '../../vehicle/geo';
import type { LayerView } from './layer-gesture';

/** A 4×4 matrix in the order of its columns, as in three.js. */
export type Matrix = ArrayLike<number>;
export type Vector = readonly [number, number, number];
/** Homogeneous coordinates of the picture; x and y divided by w are −1…1. */
export type Clip = readonly [number, number, number, number];

/** The camera of the 3D view, as viser's page has it. */
export interface SceneCamera {
  readonly projection: Matrix;
  readonly projectionInverse: Matrix;
  /** Pose of the camera in the page's scene. */
  readonly pose: Matrix;
  readonly poseInverse: Matrix;
  /** Pose of the drawn world (ENU) in the page's scene; some camera modes move it. */
  readonly world: Matrix;
  /** Position of the world's zero. */
  readonly origin: Required<LayerPosition>;
  /** Size of the view [px]. */
  readonly width: number;
  readonly height: number;
}

/** Positions nearer to the camera are not drawn [m]. */
export const NEAR_M = 0.1;
/** A pointer moves nothing farther away than this [m], because there one pixel covers a large distance. */
const REACH_M = 5000;
/** Length of the line from a point to its handle [px]. */
const HANDLE_PX = 40;
/** Below this angle between the line of sight and a level plane, a point is dragged only across the view. */
const LOW_ANGLE_RAD = 0.07;
/** Least elevation of the camera that shows all positions. */
const OVERVIEW_RAD = 0.5;
/** Smallest radius that the overview shows, so that a single position is shown with its surroundings [m]. */
const LEAST_RADIUS_M = 12;
/** Below this angle between the line of sight and the vertical, heights cannot be changed. */
const STEEP_ANGLE_RAD = 0.18;

const apply = (m: Matrix, [x, y, z, w]: Clip): Clip => {
  const row = (r: number): number => (m[r] ?? 0) * x + (m[r + 4] ?? 0) * y + (m[r + 8] ?? 0) * z + (m[r + 12] ?? 0) * w;
  return [row(0), row(1), row(2), row(3)];
};
const multiply = (a: Matrix, b: Matrix): Matrix => [0, 4, 8, 12].flatMap((c) => apply(a, [b[c] ?? 0, b[c + 1] ?? 0, b[c + 2] ?? 0, b[c + 3] ?? 0]));
const minus = (a: Vector, b: Vector): Vector => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

function unit(v: Vector): Vector {
  const length = Math.hypot(...v) || 1;
  return [v[0] / length, v[1] / length, v[2] / length];
}

export class SceneView implements LayerView {
  readonly width: number;
  readonly height: number;
  /** Position of the camera in the world's ENU [m]. */
  readonly eye: Vector;
  private readonly toClip: Matrix;

  /** @param ground_amsl_m altitude of positions without their own. */
  constructor(
    private readonly camera: SceneCamera,
    private readonly ground_amsl_m: number,
  ) {
    this.width = camera.width;
    this.height = camera.height;
    this.toClip = multiply(camera.projection, multiply(camera.poseInverse, camera.world));
    this.eye = this.inWorld([camera.pose[12] ?? 0, camera.pose[13] ?? 0, camera.pose[14] ?? 0]);
  }

  /** A position in the world's ENU [m]. */
  enuOf(at: LayerPosition): Vector {
    const { east_m, north_m } = eastNorth(this.camera.origin, at);
    return [east_m, north_m, this.upOf(at.alt_amsl_m ?? this.ground_amsl_m)];
  }

  /** An altitude in the world's ENU [m]. */
  upOf(alt_amsl_m: number): number {
    return alt_amsl_m - this.camera.origin.alt_amsl_m;
  }

  /** Height of the ground in the world's ENU [m]. */
  get ground_m(): number {
    return this.upOf(this.ground_amsl_m);
  }

  clipOf(enu: Vector): Clip {
    return apply(this.toClip, [...enu, 1]);
  }

  /** Pixel of a position in front of the camera. */
  pixelOfClip([x, y, , w]: Clip): Pixel {
    return { x: ((x / w + 1) / 2) * this.width, y: ((1 - y / w) / 2) * this.height };
  }

  readonly pixelOf = (at: LayerPosition): Pixel | null => {
    const clip = this.clipOf(this.enuOf(at));
    return clip[3] < NEAR_M ? null : this.pixelOfClip(clip);
  };

  readonly positionAt = (at: Pixel, like: LayerPosition): GeoPosition | null => {
    const point = this.enuOf(like);
    const sight = unit(minus(point, this.eye));
    return this.geoPosition(Math.abs(Math.asin(sight[2])) < LOW_ANGLE_RAD ? this.onUpright(at, point, sight) : this.onLevel(at, point[2]));
  };

  /** The point of the ground below a pixel; null: there is none within reach. */
  groundAt(at: Pixel): GeoPosition | null {
    return this.geoPosition(this.onLevel(at, this.ground_m));
  }

  readonly heightAt = (at: Pixel, above: LayerPosition): number | null => {
    const [ray, from] = [this.rayOf(at), minus(this.eye, this.enuOf(above))];
    const level = 1 - ray[2] * ray[2];
    if (level < Math.sin(STEEP_ANGLE_RAD / 2) ** 2) return null;
    // The point of the vertical that is nearest to the ray; it must be in front of the camera.
    const height_m = (from[2] - ray[2] * dot(from, ray)) / level;
    return height_m * ray[2] - dot(from, ray) > 0 && Math.abs(height_m) < REACH_M ? height_m : null;
  };

  readonly handleOf = (point: LayerPoint): Pixel | null => {
    const enu = this.enuOf(point);
    const clips = [this.clipOf(enu), this.clipOf([enu[0], enu[1], enu[2] + 0.1])] as const;
    const steep = Math.abs(unit(minus(enu, this.eye))[2]) > Math.cos(STEEP_ANGLE_RAD);
    if (steep || clips.some((clip) => clip[3] < NEAR_M)) return null;
    const [at, above] = [this.pixelOfClip(clips[0]), this.pixelOfClip(clips[1])];
    const length = Math.hypot(above.x - at.x, above.y - at.y);
    return length === 0 ? null : { x: at.x + ((above.x - at.x) / length) * HANDLE_PX, y: at.y + ((above.y - at.y) / length) * HANDLE_PX };
  };

  /**
   * Where the camera must be to show all positions from its present direction, but from above.
   * @param share the part of the view's height that is free, at both sides of the middle.
   * @returns its position and the point it looks at, in the page's scene.
   */
  overview(positions: readonly LayerPosition[], fov_rad: number, share: number): { eye: Vector; target: Vector } | null {
    if (positions.length === 0) return null;
    const all = positions.map((at) => this.enuOf(at));
    const most = (of: (at: Vector) => number): number => all.reduce((found, at) => Math.max(found, of(at)), -Infinity);
    const middle = (axis: 0 | 1 | 2): number => (most((at) => at[axis]) - most((at) => -at[axis])) / 2;
    const target: Vector = [middle(0), middle(1), middle(2)];
    const radius_m = Math.max(
      LEAST_RADIUS_M,
      most((at) => Math.hypot(...minus(at, target))),
    );
    const away_m = (radius_m * 1.2) / (Math.tan(fov_rad / 2) * Math.max(0.1, share));
    const ahead = this.ahead();
    const elevation = Math.min(Math.PI / 2 - 0.01, Math.max(OVERVIEW_RAD, Math.asin(-ahead[2])));
    const bearing = Math.atan2(ahead[0], ahead[1]);
    const back = away_m * Math.cos(elevation);
    const eye: Vector = [target[0] - back * Math.sin(bearing), target[1] - back * Math.cos(bearing), target[2] + away_m * Math.sin(elevation)];
    return { eye: this.inScene(eye), target: this.inScene(target) };
  }

  /** Converts a point of the world to the page's scene, in which the camera is moved. */
  private inScene(enu: Vector): Vector {
    const [x, y, z] = apply(this.camera.world, [...enu, 1]);
    return [x, y, z];
  }

  /** The direction in which the camera looks, in the world's ENU. */
  private ahead(): Vector {
    const { pose } = this.camera;
    const ahead: Vector = [(pose[12] ?? 0) - (pose[8] ?? 0), (pose[13] ?? 0) - (pose[9] ?? 0), (pose[14] ?? 0) - (pose[10] ?? 0)];
    return unit(minus(this.inWorld(ahead), this.eye));
  }

  /** Direction from the camera through a pixel, in the world's ENU. */
  private rayOf(at: Pixel): Vector {
    const local = apply(this.camera.projectionInverse, [(2 * at.x) / this.width - 1, 1 - (2 * at.y) / this.height, 0.5, 1]);
    const [x, y, z] = apply(this.camera.pose, [local[0] / local[3], local[1] / local[3], local[2] / local[3], 1]);
    return unit(minus(this.inWorld([x, y, z]), this.eye));
  }

  /** Converts a point of the page's scene to the world, which is moved and rotated in the scene, but not scaled. */
  private inWorld(at: Vector): Vector {
    const m = this.camera.world;
    const from = minus(at, [m[12] ?? 0, m[13] ?? 0, m[14] ?? 0]);
    const axis = (c: number): number => dot([m[c] ?? 0, m[c + 1] ?? 0, m[c + 2] ?? 0], from);
    return [axis(0), axis(4), axis(8)];
  }

  private geoPosition(enu: Vector | null): GeoPosition | null {
    if (enu === null || Math.hypot(enu[0] - this.eye[0], enu[1] - this.eye[1]) > REACH_M) return null;
    return positionAt(this.camera.origin, { east_m: enu[0], north_m: enu[1] });
  }

  private along(ray: Vector, length_m: number): Vector | null {
    if (!(length_m > 0) || !Number.isFinite(length_m)) return null;
    return [this.eye[0] + ray[0] * length_m, this.eye[1] + ray[1] * length_m, this.eye[2] + ray[2] * length_m];
  }

  /** The point below a pixel on the level plane at this height. */
  private onLevel(at: Pixel, up_m: number): Vector | null {
    const ray = this.rayOf(at);
    return this.along(ray, (up_m - this.eye[2]) / ray[2]);
  }

  /** The point below a pixel on the vertical plane that contains `point` and faces the camera. */
  private onUpright(at: Pixel, point: Vector, sight: Vector): Vector | null {
    const [ray, facing] = [this.rayOf(at), unit([sight[0], sight[1], 0])];
    return this.along(ray, dot(minus(point, this.eye), facing) / dot(ray, facing));
  }
}

const VALID = (m: unknown): m is Matrix => {
  const list = m as ArrayLike<unknown> | null | undefined;
  return list != null && list.length === 16 && Array.from(list).every((value) => typeof value === 'number' && Number.isFinite(value));
};

/** Parses the position of the world's zero, as the 3D view's page has it: "lat_deg,lon_deg,alt_amsl_m". */
export function parseOrigin(text: string | undefined): Required<LayerPosition> | null {
  const [lat_deg, lon_deg, alt_amsl_m, more] = (text ?? '').split(',').map((part) => (part.trim() === '' ? NaN : Number(part)));
  if (lat_deg === undefined || lon_deg === undefined || alt_amsl_m === undefined || more !== undefined) return null;
  return [lat_deg, lon_deg, alt_amsl_m].every(Number.isFinite) ? { lat_deg, lon_deg, alt_amsl_m } : null;
}

/** A camera whose matrices are complete and finite; null otherwise, such as while viser starts. */
export function validCamera(camera: { readonly [name in keyof SceneCamera]: SceneCamera[name] | undefined }): SceneCamera | null {
  const { projection, projectionInverse, pose, poseInverse, world, origin, width, height } = camera;
  if (![projection, projectionInverse, pose, poseInverse, world].every(VALID)) return null;
  return origin === undefined || !width || !height ? null : (camera as SceneCamera);
}
