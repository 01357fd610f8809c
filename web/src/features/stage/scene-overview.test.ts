import { describe, expect, it } from 'vitest';
import type { LayerPicture, LayerPoint } from '../../app/map-layers.svelte';
import { extentOf, SceneOverview, type CameraPose } from './scene-overview';

const CHASE: CameraPose = { eye: [-3.1, 0, 1.25], target: [0.35, 0, -0.05] };
const PLAN: CameraPose = { eye: [-80, -60, 90], target: [40, 30, 10] };
const BY_HAND: CameraPose = { eye: [-80, -50, 90], target: [40, 30, 10] };

/** An overview that has shown the plan. */
function shown(): SceneOverview {
  const overview = new SceneOverview();
  overview.request('chase');
  expect(overview.next(CHASE, 'chase', false, false)).toBe('show');
  overview.moved(CHASE, PLAN);
  return overview;
}

describe('the camera of the 3D view, when a plan is opened', () => {
  it('waits until the 3D view is large, then shows the plan once', () => {
    const overview = new SceneOverview();
    expect([overview.isActive, overview.next(CHASE, 'chase', false, false)]).toEqual([false, null]);
    overview.request('chase');
    expect(overview.next(CHASE, 'chase', true, false)).toBeNull();
    expect(overview.next(CHASE, 'chase', false, false)).toBe('show');
    overview.moved(CHASE, PLAN);
    expect(overview.next(PLAN, 'chase', false, false)).toBeNull();
    expect(overview.next(CHASE, 'chase', false, false)).toBeNull();
  });

  it('is not moved while a vehicle flies or the camera follows a dry run, nor afterwards', () => {
    const overview = new SceneOverview();
    overview.request('chase');
    expect(overview.next(CHASE, 'chase', false, true)).toBeNull();
    expect(overview.next(CHASE, 'chase', false, false)).toBeNull();
  });

  it('stays where a person has moved it, or in the mode that a person has chosen since', () => {
    const moved = shown();
    expect(moved.next(BY_HAND, 'chase', false, false)).toBeNull();
    moved.grow();
    expect([moved.next(BY_HAND, 'chase', false, false), moved.next(BY_HAND, 'chase', false, true), moved.release(BY_HAND)]).toEqual([null, null, null]);
    const waiting = new SceneOverview();
    waiting.request('chase');
    expect(waiting.next(CHASE, 'top', false, false)).toBeNull();
    const seen = new SceneOverview();
    seen.request('gimbal');
    expect(seen.next(CHASE, 'gimbal', false, false)).toBeNull();
  });

  it('shows the plan again when the server has sent its path', () => {
    const overview = shown();
    overview.grow();
    expect(overview.next(PLAN, 'chase', false, false)).toBe('show');
    expect(overview.next(PLAN, 'chase', false, false)).toBeNull();
  });

  it('shows the next plan, also after a person has moved the camera', () => {
    const overview = shown();
    overview.next(BY_HAND, 'chase', false, false);
    overview.request('chase');
    expect(overview.next(BY_HAND, 'chase', false, false)).toBe('show');
  });

  it('returns to where it was, when a vehicle is armed or the room is closed', () => {
    const armed = shown();
    expect(armed.next(PLAN, 'chase', false, true)).toEqual(CHASE);
    expect([armed.isActive, armed.next(CHASE, 'chase', false, true)]).toEqual([false, null]);
    expect(shown().release(PLAN)).toEqual(CHASE);
    const twice = shown();
    twice.grow();
    twice.next(PLAN, 'chase', false, false);
    twice.moved(PLAN, BY_HAND);
    expect(twice.release(BY_HAND)).toEqual(CHASE);
    const shownAll = shown();
    shownAll.cancel();
    expect(shownAll.release(PLAN)).toBeNull();
  });
});

it('shows points, lines and tops of the layers that the 3D view has', () => {
  const [point, end] = [{ id: 'a', lat_deg: 47.4, lon_deg: 8.5 } as LayerPoint, { lat_deg: 47.5, lon_deg: 8.5, alt_amsl_m: 500 }];
  const flat: LayerPicture = { points: [point], lines: [{ positions: [end], tone: 'target', style: 'solid' }], areas: [] };
  expect(extentOf([flat])).toEqual([]);
  expect(extentOf([{ ...flat, ground: end }])).toEqual([point, end]);
  const solids = [{ ring: [{ lat_deg: 47.6, lon_deg: 8.5 }], top_amsl_m: 520, tone: 'danger' as const }];
  expect(extentOf([{ ...flat, solids, ground: end }]).at(-1)).toEqual({ lat_deg: 47.6, lon_deg: 8.5, alt_amsl_m: 520 });
});
