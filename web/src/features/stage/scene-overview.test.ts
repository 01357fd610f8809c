import { describe, expect, it } from 'vitest';
import type { LayerContent, LayerPoint } from '../../app/map-layers.svelte';
import { scenePositions, SceneOverview, type CameraPose } from './scene-overview';

const CHASE_POSE: CameraPose = { eye: [-3.1, 0, 1.25], target: [0.35, 0, -0.05] };
const PLAN_POSE: CameraPose = { eye: [-80, -60, 90], target: [40, 30, 10] };
const MOVED_BY_PERSON: CameraPose = { eye: [-80, -50, 90], target: [40, 30, 10] };

/** An overview that has moved the camera to show the plan. */
function shownOverview(): SceneOverview {
  const overview = new SceneOverview();
  overview.request('chase');
  expect(overview.nextMove(CHASE_POSE, 'chase', false, false)).toBe('show');
  overview.recordMove(CHASE_POSE, PLAN_POSE);
  return overview;
}

describe('the camera of the 3D view, when a plan is opened', () => {
  it('waits until the 3D view is large, then shows the plan once', () => {
    const overview = new SceneOverview();
    expect([overview.isActive, overview.nextMove(CHASE_POSE, 'chase', false, false)]).toEqual([false, null]);
    overview.request('chase');
    expect(overview.nextMove(CHASE_POSE, 'chase', true, false)).toBeNull();
    expect(overview.nextMove(CHASE_POSE, 'chase', false, false)).toBe('show');
    overview.recordMove(CHASE_POSE, PLAN_POSE);
    expect(overview.nextMove(PLAN_POSE, 'chase', false, false)).toBeNull();
    expect(overview.nextMove(CHASE_POSE, 'chase', false, false)).toBeNull();
  });

  it('is not moved if a vehicle is flying or the camera follows a dry run at the request', () => {
    const overview = new SceneOverview();
    overview.request('chase');
    expect(overview.nextMove(CHASE_POSE, 'chase', false, true)).toBeNull();
    expect(overview.nextMove(CHASE_POSE, 'chase', false, false)).toBeNull();
  });

  it('is not moved after a person has moved it or has chosen another camera mode', () => {
    const moved = shownOverview();
    expect(moved.nextMove(MOVED_BY_PERSON, 'chase', false, false)).toBeNull();
    moved.refit();
    expect([moved.nextMove(MOVED_BY_PERSON, 'chase', false, false), moved.nextMove(MOVED_BY_PERSON, 'chase', false, true), moved.end(MOVED_BY_PERSON)]).toEqual(
      [null, null, null],
    );
    const otherMode = new SceneOverview();
    otherMode.request('chase');
    expect(otherMode.nextMove(CHASE_POSE, 'top', false, false)).toBeNull();
    const gimbalMode = new SceneOverview();
    gimbalMode.request('gimbal');
    expect(gimbalMode.nextMove(CHASE_POSE, 'gimbal', false, false)).toBeNull();
  });

  it('shows the plan again when the server has compiled the path', () => {
    const overview = shownOverview();
    overview.refit();
    expect(overview.nextMove(PLAN_POSE, 'chase', false, false)).toBe('show');
    expect(overview.nextMove(PLAN_POSE, 'chase', false, false)).toBeNull();
  });

  it('shows the next plan, also after a person has moved the camera', () => {
    const overview = shownOverview();
    overview.nextMove(MOVED_BY_PERSON, 'chase', false, false);
    overview.request('chase');
    expect(overview.nextMove(MOVED_BY_PERSON, 'chase', false, false)).toBe('show');
  });

  it('returns to its earlier pose when a vehicle is armed or the room is closed', () => {
    const armedOverview = shownOverview();
    expect(armedOverview.nextMove(PLAN_POSE, 'chase', false, true)).toEqual(CHASE_POSE);
    expect([armedOverview.isActive, armedOverview.nextMove(CHASE_POSE, 'chase', false, true)]).toEqual([false, null]);
    expect(shownOverview().end(PLAN_POSE)).toEqual(CHASE_POSE);
    const refitted = shownOverview();
    refitted.refit();
    refitted.nextMove(PLAN_POSE, 'chase', false, false);
    refitted.recordMove(PLAN_POSE, MOVED_BY_PERSON);
    expect(refitted.end(MOVED_BY_PERSON)).toEqual(CHASE_POSE);
    const cancelledOverview = shownOverview();
    cancelledOverview.cancel();
    expect(cancelledOverview.end(PLAN_POSE)).toBeNull();
  });
});

it('the extent contains points, lines and tops of the layers with a ground', () => {
  const [point, end] = [{ id: 'a', lat_deg: 47.4, lon_deg: 8.5 } as LayerPoint, { lat_deg: 47.5, lon_deg: 8.5, alt_amsl_m: 500 }];
  const layer: LayerContent = { points: [point], lines: [{ positions: [end], tone: 'target', style: 'solid' }], areas: [] };
  expect(scenePositions([layer])).toEqual([]);
  expect(scenePositions([{ ...layer, ground: end }])).toEqual([point, end]);
  const solids = [{ ring: [{ lat_deg: 47.6, lon_deg: 8.5 }], top_amsl_m: 520, tone: 'danger' as const }];
  expect(scenePositions([{ ...layer, solids, ground: end }]).at(-1)).toEqual({ lat_deg: 47.6, lon_deg: 8.5, alt_amsl_m: 520 });
});
