import { describe, expect, it } from 'vitest';
import type { LayerPicture, LayerPoint } from '../../app/map-layers.svelte';
import { scenePositions, SceneOverview, type CameraPose } from './scene-overview';

const CHASE: CameraPose = { eye: [-3.1, 0, 1.25], target: [0.35, 0, -0.05] };
const PLAN: CameraPose = { eye: [-80, -60, 90], target: [40, 30, 10] };
const MOVED_BY_PERSON: CameraPose = { eye: [-80, -50, 90], target: [40, 30, 10] };

/** An overview that has moved the camera to show the plan. */
function shownOverview(): SceneOverview {
  const overview = new SceneOverview();
  overview.request('chase');
  expect(overview.nextMove(CHASE, 'chase', false, false)).toBe('show');
  overview.recordMove(CHASE, PLAN);
  return overview;
}

describe('the camera of the 3D view, when a plan is opened', () => {
  it('waits until the 3D view is large, then shows the plan once', () => {
    const overview = new SceneOverview();
    expect([overview.isActive, overview.nextMove(CHASE, 'chase', false, false)]).toEqual([false, null]);
    overview.request('chase');
    expect(overview.nextMove(CHASE, 'chase', true, false)).toBeNull();
    expect(overview.nextMove(CHASE, 'chase', false, false)).toBe('show');
    overview.recordMove(CHASE, PLAN);
    expect(overview.nextMove(PLAN, 'chase', false, false)).toBeNull();
    expect(overview.nextMove(CHASE, 'chase', false, false)).toBeNull();
  });

  it('is not moved if a vehicle is flying or the camera follows a dry run at the request', () => {
    const overview = new SceneOverview();
    overview.request('chase');
    expect(overview.nextMove(CHASE, 'chase', false, true)).toBeNull();
    expect(overview.nextMove(CHASE, 'chase', false, false)).toBeNull();
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
    expect(otherMode.nextMove(CHASE, 'top', false, false)).toBeNull();
    const gimbalMode = new SceneOverview();
    gimbalMode.request('gimbal');
    expect(gimbalMode.nextMove(CHASE, 'gimbal', false, false)).toBeNull();
  });

  it('shows the plan again when the server has compiled the path', () => {
    const overview = shownOverview();
    overview.refit();
    expect(overview.nextMove(PLAN, 'chase', false, false)).toBe('show');
    expect(overview.nextMove(PLAN, 'chase', false, false)).toBeNull();
  });

  it('shows the next plan, also after a person has moved the camera', () => {
    const overview = shownOverview();
    overview.nextMove(MOVED_BY_PERSON, 'chase', false, false);
    overview.request('chase');
    expect(overview.nextMove(MOVED_BY_PERSON, 'chase', false, false)).toBe('show');
  });

  it('returns to its earlier pose when a vehicle is armed or the room is closed', () => {
    const armed = shownOverview();
    expect(armed.nextMove(PLAN, 'chase', false, true)).toEqual(CHASE);
    expect([armed.isActive, armed.nextMove(CHASE, 'chase', false, true)]).toEqual([false, null]);
    expect(shownOverview().end(PLAN)).toEqual(CHASE);
    const twice = shownOverview();
    twice.refit();
    twice.nextMove(PLAN, 'chase', false, false);
    twice.recordMove(PLAN, MOVED_BY_PERSON);
    expect(twice.end(MOVED_BY_PERSON)).toEqual(CHASE);
    const cancelled = shownOverview();
    cancelled.cancel();
    expect(cancelled.end(PLAN)).toBeNull();
  });
});

it('the extent contains points, lines and tops of the layers with a ground', () => {
  const [point, end] = [{ id: 'a', lat_deg: 47.4, lon_deg: 8.5 } as LayerPoint, { lat_deg: 47.5, lon_deg: 8.5, alt_amsl_m: 500 }];
  const flat: LayerPicture = { points: [point], lines: [{ positions: [end], tone: 'target', style: 'solid' }], areas: [] };
  expect(scenePositions([flat])).toEqual([]);
  expect(scenePositions([{ ...flat, ground: end }])).toEqual([point, end]);
  const solids = [{ ring: [{ lat_deg: 47.6, lon_deg: 8.5 }], top_amsl_m: 520, tone: 'danger' as const }];
  expect(scenePositions([{ ...flat, solids, ground: end }]).at(-1)).toEqual({ lat_deg: 47.6, lon_deg: 8.5, alt_amsl_m: 520 });
});
