import { describe, expect, it } from 'vitest';
import type { LayerEditor, LayerPoint, LayerPosition } from '../../app/map-layers.svelte';
import { eastNorth, positionAt, type GeoPosition } from '../../vehicle/geo';
import { LayerGesture, targetAt, withHandles } from './layer-gesture';
import { drawnPoints, MAX_POINTS, visibleArea, visibleParts } from './scene-draw';
import { facesOf } from './scene-solids';
import { SceneTerrain } from './scene-terrain';
import { NEAR_M, parseOrigin, SceneView, validCamera, type Clip, type Matrix, type SceneCamera } from './scene-view';

const ORIGIN = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const IDENTITY: Matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
const [WIDTH, HEIGHT, FOCAL] = [800, 600, 1.5];

/** A camera at `eye` (ENU) that looks north and down; by default the scene has the axes of the world. */
function cameraLookingNorth(eye: readonly [number, number, number], down_rad: number, world: Matrix = IDENTITY): SceneCamera {
  const [sin, cos] = [Math.sin(down_rad), Math.cos(down_rad)];
  // The camera’s axes: right (east), up, backwards.
  const pose = [1, 0, 0, 0, 0, sin, cos, 0, 0, -cos, sin, 0, ...eye, 1];
  const [x, y, z] = eye;
  const poseInverse = [1, 0, 0, 0, 0, sin, -cos, 0, 0, cos, sin, 0, -x, -(sin * y + cos * z), cos * y - sin * z, 1];
  const aspect = WIDTH / HEIGHT;
  const projection = [FOCAL / aspect, 0, 0, 0, 0, FOCAL, 0, 0, 0, 0, -1, -1, 0, 0, -0.2, 0];
  const projectionInverse = [aspect / FOCAL, 0, 0, 0, 0, 1 / FOCAL, 0, 0, 0, 0, 0, -5, 0, 0, -1, 5];
  return { projection, projectionInverse, pose, poseInverse, world, origin: ORIGIN, width: WIDTH, height: HEIGHT };
}
const viewFrom = (eye: readonly [number, number, number], down_rad: number, world?: Matrix): SceneView =>
  new SceneView(cameraLookingNorth(eye, down_rad, world), 480);
const at = (east_m: number, north_m: number, up_m?: number): LayerPosition => ({
  ...positionAt(ORIGIN, { east_m, north_m }),
  ...(up_m === undefined ? {} : { alt_amsl_m: 480 + up_m }),
});
const point = (id: string, position: LayerPosition, fields: Partial<LayerPoint> = {}): LayerPoint => ({
  ...position,
  id,
  mark: 'disc',
  tone: 'target',
  text: '',
  selected: false,
  ...fields,
});
const eastNorth_m = (position: GeoPosition | null): number[] => {
  if (position === null) return [];
  const { east_m, north_m } = eastNorth(ORIGIN, position);
  return [Math.round(east_m * 1000) / 1000 + 0, Math.round(north_m * 1000) / 1000 + 0];
};

describe('a position in the 3D view', () => {
  const view = viewFrom([0, -60, 40], 0.5);

  it('is in the middle if the camera looks at it, and not visible behind the camera', () => {
    const ahead = viewFrom([0, -40, 40], Math.PI / 4).pixelOf(at(0, 0));
    expect([ahead?.x, ahead?.y].map((value) => Math.round(value ?? 0))).toEqual([400, 300]);
    expect(view.pixelOf(at(0, -200, 0))).toBeNull();
  });

  it('is the same after projection and back, at any altitude and in a turned world', () => {
    const turnedWorld = [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 5, 20, -3, 1];
    for (const testedView of [view, viewFrom([0, -60, 40], 0.5, turnedWorld)])
      for (const position of [at(10, 5), at(-12, 8, 20), at(3, -2, 31)]) {
        const pixel = testedView.pixelOf(position);
        expect(eastNorth_m(pixel === null ? null : testedView.positionAt(pixel, position))).toEqual(eastNorth_m(position));
      }
  });

  it('does not exist above the horizon or too far away', () => {
    expect(view.groundAt({ x: 400, y: -600 })).toBeNull();
    expect(viewFrom([0, 0, 3], 0).groundAt({ x: 400, y: 300.1 })).toBeNull();
    expect(eastNorth_m(viewFrom([0, -40, 40], Math.PI / 4).groundAt({ x: 400, y: 300 }))).toEqual([0, 0]);
  });

  it('is moved only across the view if the camera is at the level of the point', () => {
    const lowView = viewFrom([0, -60, 20], 0);
    const reference = at(0, 0, 20);
    expect(eastNorth_m(lowView.positionAt({ x: 500, y: 300 }, reference))[1]).toBe(0);
    expect(eastNorth_m(lowView.positionAt({ x: 500, y: 180 }, reference))).toEqual(eastNorth_m(lowView.positionAt({ x: 500, y: 300 }, reference)));
  });
});

describe('the altitude of a point', () => {
  const view = viewFrom([0, -60, 40], 0.5);

  it('follows the pointer along the vertical line', () => {
    const above = view.pixelOf(at(5, 4, 27));
    expect(view.heightAt(above ?? { x: 0, y: 0 }, at(5, 4, 20))).toBeCloseTo(7, 6);
  });

  it('has a handle above the selected point, but not from straight above', () => {
    const selected = point('a', at(5, 4, 20), { selected: true, altitudeText: '20 m' });
    const [pixel, handle] = [view.pixelOf(selected), view.handleOf(selected)];
    expect((pixel?.y ?? 0) - (handle?.y ?? 0)).toBeGreaterThan(35);
    expect(targetAt(view, handle ?? { x: 0, y: 0 }, [selected], 14)).toEqual({ point: selected, part: 'handle' });
    expect(targetAt(view, pixel ?? { x: 0, y: 0 }, [selected], 14)).toEqual({ point: selected, part: 'point' });
    expect(viewFrom([5, 3, 60], Math.PI / 2 - 0.01).handleOf(selected)).toBeNull();
    expect(viewFrom([5, 4, 60], Math.PI / 2).heightAt({ x: 400, y: 300 }, selected)).toBeNull();
  });

  it('has only one handle if many points are selected', () => {
    const manyPoints = Array.from({ length: 9 }, (_, i) => point(String(i), at(i, 0, 10), { selected: true, altitudeText: '10 m' }));
    expect(withHandles(manyPoints)).toEqual([manyPoints[0]]);
    expect(withHandles([...manyPoints.slice(0, 3), point('corner', at(0, 0), { selected: true })])).toEqual(manyPoints.slice(0, 3));
  });

  it('is changed by a drag of the handle, in one gesture', () => {
    const calls: unknown[] = [];
    const editor: LayerEditor = {
      pick: (id) => void calls.push(['pick', id]),
      grab: (id) => (calls.push(['grab', id]), id),
      drag: () => void calls.push(['drag']),
      raise: (by_m) => void calls.push(['raise', Math.round(by_m * 10) / 10]),
      drop: (keep) => void calls.push(['drop', keep]),
      press: () => false,
      remove: () => false,
    };
    const selected = point('a', at(0, 0, 20), { selected: true, altitudeText: '20 m' });
    const [begin, end] = [view.pixelOf(at(0, 0, 24)), view.pixelOf(at(0, 0, 29))];
    const gesture = new LayerGesture(editor);
    gesture.start(view, begin ?? { x: 0, y: 0 }, { point: selected, part: 'handle' }, false);
    gesture.move(view, end ?? { x: 0, y: 0 });
    gesture.end();
    gesture.start(view, begin ?? { x: 0, y: 0 }, { point: selected, part: 'handle' }, false);
    gesture.end();
    expect(calls).toEqual([
      ['grab', 'a'],
      ['raise', 5],
      ['drop', true],
    ]);
  });
});

describe('the drawing', () => {
  const clip = (x: number, w: number): Clip => [x, 0, 0, w];

  it('contains only the parts of lines and areas in front of the camera', () => {
    expect(visibleParts([clip(0, 5), clip(1, 5), clip(2, -5), clip(3, -5), clip(4, 5)])).toHaveLength(2);
    expect(visibleParts([clip(0, -5), clip(1, -1)])).toEqual([]);
    for (const part of visibleParts([clip(0, 5), clip(2, -5)])) expect(part.at(-1)?.[3]).toBe(NEAR_M);
    expect(visibleArea([clip(0, 5), clip(1, 5), clip(2, -5)])).toHaveLength(4);
    expect(visibleArea([clip(0, -5), clip(1, -5), clip(2, -5)])).toEqual([]);
  });

  it('has midpoints below all other points, selected points above, and near points above far points', () => {
    const view = viewFrom([0, -60, 40], 0.5);
    const points = [
      point('near', at(0, -20, 0)),
      point('far', at(0, 40, 0)),
      point('middle', at(0, -25, 0), { mark: 'midpoint' }),
      point('selected', at(0, 50, 0), { selected: true }),
      point('behind', at(0, -200, 0)),
    ];
    expect(drawnPoints(view, points).map((drawn) => drawn.point.id)).toEqual(['middle', 'far', 'near', 'selected']);
    const manyPoints = Array.from({ length: MAX_POINTS + 50 }, (_, i) => point(String(i), at(0, i / 10, 0)));
    const drawn = drawnPoints(view, manyPoints);
    expect(drawn).toHaveLength(MAX_POINTS);
    expect(drawn.some(({ point: { id } }) => id === '0')).toBe(true);
  });

  it('has solids with their true heights, the nearest solid last and its front faces last', () => {
    const box = (north_m: number, up_m: number) => ({
      ring: [at(-5, north_m), at(5, north_m), at(5, north_m + 10), at(-5, north_m + 10)],
      top_amsl_m: 480 + up_m,
      tone: 'danger' as const,
    });
    const faces = facesOf(viewFrom([0, -60, 40], 0.5), [box(0, 12), box(100, 60), box(50, 0)]);
    expect(faces).toHaveLength(10);
    const rounded = faces.map(({ ring, facesCamera }) => ({ facesCamera, ring: ring.map((corner) => corner.map((metre) => Math.round(metre) + 0)) }));
    const front = (north_m: number, up_m: number) => ({
      facesCamera: true,
      ring: [
        [-5, north_m, 0],
        [5, north_m, 0],
        [5, north_m, up_m],
        [-5, north_m, up_m],
      ],
    });
    const top = {
      facesCamera: true,
      ring: [
        [-5, 0, 12],
        [5, 0, 12],
        [5, 10, 12],
        [-5, 10, 12],
      ],
    };
    // The camera is below the top of the far box, so this top does not face the camera.
    expect([rounded.slice(0, 5).filter(({ facesCamera }) => facesCamera), rounded.slice(5).filter(({ facesCamera }) => facesCamera)]).toEqual([
      [front(100, 60)],
      [front(0, 12), top],
    ]);
    expect(rounded[4]).toEqual(front(100, 60));
    expect(faces.slice(5).flatMap(({ edges, facesCamera }) => (facesCamera ? edges : []))).toHaveLength(4);
    const circle = Array.from({ length: 24 }, (_, i) => at(5 * Math.cos((i * Math.PI) / 12), 5 * Math.sin((i * Math.PI) / 12)));
    const uprightEdges = facesOf(viewFrom([0, -60, 40], 0.5), [{ ring: circle, top_amsl_m: 500, tone: 'danger' }]).flatMap(({ edges, facesCamera }) =>
      facesCamera ? edges.filter(([a, b]) => a?.[2] !== b?.[2]) : [],
    );
    expect(uprightEdges).toHaveLength(2);
    const clockwise = { ...box(0, 12), ring: box(0, 12).ring.reverse() };
    expect(facesOf(viewFrom([0, -60, 40], 0.5), [clockwise]).filter(({ facesCamera }) => facesCamera)).toHaveLength(2);
  });

  it('has an overview pose from which all points are visible in the free area', () => {
    const view = viewFrom([0, -60, 2], 0);
    const points = [at(0, 0, 0), at(100, 0, 20), at(100, 80, 0)];
    const pose = view.overviewPose(points, 0.9, 0.7);
    expect(pose?.target).toEqual([50, 40, 10].map((value) => expect.closeTo(value, 3)));
    const [east, north, up] = pose?.eye ?? [0, 0, 0];
    const overview = viewFrom([east, north, up], Math.atan2(up - 10, 40 - north));
    for (const position of points) {
      const pixel = overview.pixelOf(position);
      expect(Math.abs((pixel?.y ?? 999) - 300)).toBeLessThan(300 * 0.7);
    }
    expect(view.overviewPose([], 0.9, 0.7)).toBeNull();
  });
});

describe('the camera of the frame', () => {
  it('is used only if it is complete and finite', () => {
    const camera = cameraLookingNorth([0, 0, 5], 0.3);
    expect(validCamera(camera)).toBe(camera);
    expect(validCamera({ ...camera, world: undefined })).toBeNull();
    expect(validCamera({ ...camera, pose: [NaN, ...Array.from(camera.pose).slice(1)] })).toBeNull();
    expect(validCamera({ ...camera, projection: [1, 2, 3] })).toBeNull();
    expect(validCamera({ ...camera, width: 0 })).toBeNull();
  });

  it('has the origin that the page of the 3D view contains, or none', () => {
    expect(parseOrigin('47.4,8.5,480')).toEqual(ORIGIN);
    for (const text of [undefined, '', '47.4,8.5', '47.4,8.5,', '47.4,8.5,NaN', '47.4,8.5,480,1', 'a,b,c']) expect(parseOrigin(text)).toBeNull();
  });
});

describe('on hills', () => {
  /** Level to the north of home, then a slope of 1 in 2. */
  const lines = Array.from({ length: 201 }, (_, i) => 10 * (i - 100));
  const slope = new SceneTerrain(lines.flatMap((north) => lines.flatMap((east) => [east, north, Math.max(0, north) / 2])));
  const view = new SceneView(cameraLookingNorth([0, -50, 30], 0.3), 480, slope);

  it('stands positions without an altitude on the ground, and others at theirs', () => {
    expect(view.enuOf(at(0, 40))[2]).toBeCloseTo(20, 1);
    expect(view.enuOf(at(0, 40, 7))[2]).toBeCloseTo(7);
    expect(view.enuOf(at(0, 5000))[2]).toBeCloseTo(0);
  });

  it('draws the line below a path along the ground', () => {
    const line = view.onGround([
      [0, -40, 50],
      [0, 40, 50],
    ]);
    expect(line.length).toBeGreaterThan(7);
    expect(line.at(-1)?.[2]).toBeCloseTo(20, 1);
    expect(Math.max(...line.filter(([, north]) => north < 0).map(([, , up]) => up))).toBe(0);
  });

  it('stands obstacles on the ground, whatever the height of home, up to their true top', () => {
    const box = (top_m: number) => ({ ring: [at(-5, -20), at(5, -20), at(5, 60), at(-5, 60)], top_amsl_m: 480 + top_m, tone: 'danger' as const });
    const faces = facesOf(view, [box(40)]);
    const side = faces.find(({ ring }) => ring.length > 8 && ring.every(([east]) => Math.abs(east - 5) < 0.1));
    const foot = (side?.ring ?? []).filter(([, , up_m]) => Math.abs(up_m - 40) > 0.1);
    for (const [, north_m, up_m] of foot) expect(up_m).toBeCloseTo(Math.max(0, north_m) / 2, 1);
    expect(foot.length).toBeGreaterThan(7);
    expect(side?.edges[0]).toHaveLength(foot.length);
    const cut = facesOf(view, [box(20)]).flatMap(({ ring }) => ring.map(([, , up_m]) => up_m));
    expect(Math.max(...cut)).toBeCloseTo(20);
    expect(facesOf(view, [{ ...box(12), ring: box(12).ring.map((corner) => ({ ...corner, ...positionAt(corner, { east_m: 0, north_m: 60 }) })) }])).toEqual([]);
    expect(facesOf(view, [box(-1)])).toEqual([]);
  });

  it('finds the place on the slope at a pixel, not behind it', () => {
    const pixel = view.pixelOf(at(5, 40));
    const found = eastNorth_m(view.groundAt(pixel ?? { x: 0, y: 0 }));
    expect(found[1]).toBeCloseTo(40, -0.5);
    expect(found[0]).toBeCloseTo(5, -0.5);
  });
});
