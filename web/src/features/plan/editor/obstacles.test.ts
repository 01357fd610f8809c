import { describe, expect, it } from 'vitest';
import { groundDistance_m, positionAt } from '../../../vehicle/geo';
import { layerOf, positionIn } from '../document-kinds';
import { EMPTY_PLAN, obstaclesOf, type Obstacle, type Plan } from '../document/document';
import { PlanEditor } from './editor.svelte';
import { fixOf, type Finding } from '../document/fixes';
import { newItem } from '../document/items';
import { planLayer } from '../document/layer';
import { planEntries } from '../document/list-entries';
import * as offboard from '../offboard/fixes';
import { missionFrameOf } from '../offboard/positions';
import { newMission } from '../offboard/step-titles';
import { missionProfile, obstacleAreas, profile } from '../profile/profile';

const HOME = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const at = (north_m: number, east_m = 0) => positionAt(HOME, { north_m, east_m });
const CORNERS = [at(20, -5), at(30, -5), at(30, 5), at(20, 5)];
const BARN: Obstacle = { name: 'Barn', polygon: CORNERS, top: { value_m: 8, reference: 'home' } };
const NO_SELECTION: ReadonlySet<string> = new Set();

function editorWithObstacle(mission = false): PlanEditor {
  const editor = new PlanEditor();
  if (mission) editor.beginMission(HOME);
  else editor.begin(HOME);
  editor.startPlacing({ type: 'area', use: 'obstacle' });
  for (const corner of CORNERS) editor.press(corner);
  editor.addArea('obstacle', editor.sketchCorners);
  return editor;
}
const north_m = (editor: PlanEditor, id: string): number => Math.round(groundDistance_m(HOME, positionIn(editor.document, id, editor.frame) ?? HOME));

describe.each([false, true])('an obstacle in the editor (mission: %s)', (mission) => {
  it('is drawn by its corners, which are then selected', () => {
    const editor = editorWithObstacle(mission);
    expect(obstaclesOf(editor.document)).toMatchObject([{ name: '', top: { value_m: 10, reference: 'home' } }]);
    expect([...editor.selected]).toEqual([0, 1, 2, 3].map((corner) => `obstacle:0:${corner}`));
    expect(editor.partToPlace).toBeNull();
    editor.undo();
    expect(obstaclesOf(editor.document)).toEqual([]);
    expect(editor.selected.size).toBe(0);
  });

  it('is dragged as a whole, or by one corner', () => {
    const editor = editorWithObstacle(mission);
    editor.grab('obstacle:0:0');
    editor.drag('obstacle:0:0', at(120, -5));
    editor.drop(true);
    expect(north_m(editor, 'obstacle:0:1')).toBe(130);
    editor.select(['obstacle:0:1']);
    editor.grab('obstacle:0:1');
    editor.drag('obstacle:0:1', at(200, 0));
    editor.drop(true);
    expect([0, 1, 2].map((corner) => north_m(editor, `obstacle:0:${corner}`))).toEqual([120, 200, 130]);
  });

  it('gets a corner by dragging a midpoint, and is removed when fewer than three corners remain', () => {
    const editor = editorWithObstacle(mission);
    expect(editor.grab('edge:0:4')).toBe('obstacle:0:4');
    editor.drag('obstacle:0:4', at(10, 0));
    editor.drop(true);
    expect(north_m(editor, 'obstacle:0:4')).toBe(10);
    editor.select(['obstacle:0:0', 'obstacle:0:1']);
    expect(editor.remove()).toBe(true);
    expect(obstaclesOf(editor.document)[0]?.polygon).toHaveLength(3);
    editor.select(['obstacle:0:2']);
    editor.remove();
    expect(obstaclesOf(editor.document)).toEqual([]);
  });
});

describe('a plan with obstacles', () => {
  const plan: Plan = {
    ...EMPTY_PLAN,
    planned_home: HOME,
    items: [newItem('waypoint', at(60), { value_m: 5, reference: 'home' })],
    obstacles: [BARN, { ...BARN, name: ' ', top: { value_m: 500, reference: 'amsl' } }],
  };

  it('shows the obstacles on the map and in the list', () => {
    const { lines, areas, points } = planLayer(plan, NO_SELECTION, null, HOME);
    expect(lines.filter((line) => line.style === 'solid' && line.tone === 'danger')).toHaveLength(2);
    expect(areas.map((area) => area.ring)).toEqual([CORNERS, CORNERS]);
    expect(points.filter(({ id }) => id.startsWith('obstacle:1:'))).toHaveLength(4);
    expect(planLayer(plan, NO_SELECTION, null, HOME).solids).toEqual([488, 500].map((top_amsl_m) => ({ ring: CORNERS, top_amsl_m, tone: 'danger' })));
    expect(planEntries(plan).map((entry) => `${entry.title}|${entry.detail}`)).toEqual([
      'Home|480.0 m AMSL',
      'Waypoint|5.0 m above home',
      'Barn|obstacle, top 8.0 m above home',
      'Obstacle 2|obstacle, top 500.0 m AMSL',
    ]);
  });

  it('has an altitude profile with the crossed obstacles up to their tops', () => {
    const shape = profile(plan);
    expect(shape.obstacles.map(({ from_m, to_m, top_m }) => [from_m, to_m, top_m].map(Math.round))).toEqual([
      [20, 30, 8],
      [20, 30, 20],
    ]);
    expect(shape.top_m).toBe(30);
    expect(obstacleAreas({ ...shape, obstacles: shape.obstacles.slice(0, 1) }, 600, 300)).toBe('M200.0 300V220.0h100.0V300Z');
    expect(profile({ ...plan, items: [newItem('waypoint', at(0, 60), { value_m: 5, reference: 'home' })] }).obstacles).toEqual([]);
  });

  it('has a fix that deletes an obstacle whose sides cross', () => {
    const place = { row: null, zone: null, rally_point: null, obstacle: 0, step: null };
    const finding: Finding = { code: 'obstacle_invalid', severity: 'error', text: '', fix: null, limit: null, place };
    expect(fixOf(plan, finding, null)?.plan.obstacles).toEqual(plan.obstacles?.slice(1));
  });

  it('may have been stored without the field `obstacles`', () => {
    const { obstacles: _, ...olderPlan } = plan;
    expect(planLayer(olderPlan, NO_SELECTION, null, HOME).areas).toEqual([]);
    expect(planEntries(olderPlan)).toHaveLength(2);
  });
});

describe('a mission with obstacles', () => {
  const mission = { ...newMission(HOME), obstacles: [BARN] };
  const frame = missionFrameOf(mission, HOME, HOME);

  it('shows the obstacles in the 3D view from the ground to their tops', () => {
    const layer = layerOf(mission, NO_SELECTION, null, frame, { flight: null, isCurrent: false });
    expect(layer.solids).toEqual([{ ring: CORNERS, top_amsl_m: 488, tone: 'danger' }]);
  });

  it('has a profile with the obstacles that its compiled path crosses', () => {
    const points = [
      [0, 0, 0, -10],
      [10, 25, 0, -10],
      [20, 25, 40, -10],
    ] as const;
    const leg = { place: 'step 2', title: 'Fly', start_s: 0, duration_s: 20, main: true, points };
    const flight = { steps: [], legs: [{ ...leg, role: null }], roles: [], closest: [], needs: [], start_ned_m: [0, 0, 0] as const, origin: HOME };
    const [span] = missionProfile(flight, [], mission).obstacles;
    expect(span).toMatchObject({ top_m: 8 });
    expect([span?.from_m, span?.to_m].map((metres) => Math.round(metres ?? 0))).toEqual([20, 30]);
    expect(missionProfile({ ...flight, origin: null }, [], mission).obstacles).toEqual([]);
  });

  it('has fixes that set the vehicle’s home or delete the obstacle', () => {
    const finding = (code: string): Finding => {
      const place = { row: null, zone: null, rally_point: null, obstacle: 0, step: null };
      return { code, severity: 'error', text: '', fix: null, limit: null, place };
    };
    expect(offboard.fixOf(mission, finding('obstacle_invalid'), frame)?.plan.obstacles).toEqual([]);
    expect(offboard.fixOf({ ...mission, home: null }, finding('obstacles_unknown'), frame)?.plan.home).toEqual(HOME);
  });
});
