import { describe, expect, it } from 'vitest';
import { groundDistance_m, positionAt } from '../../../vehicle/geo';
import { EMPTY_PLAN, positionOf, type Item, type Plan } from './document';
import { insertItem, movePoint, remove, reorder, raisePoint } from './edit';
import { parseNumber } from '../../../vehicle/fields';
import { fixOf, type Finding } from './fixes';
import * as history from './document';
import { newItem } from './items';
import { planLayer, ringOf } from './layer';
import { groundAreas, polylines, profile } from '../profile/profile';
import { planEntries } from './list-entries';

const HOME = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const at = (north_m: number, east_m = 0) => positionAt(HOME, { north_m, east_m });
const waypoint = (north_m: number, value_m = 30): Item => newItem('waypoint', at(north_m), { value_m, reference: 'home' });
const planOf = (...items: Item[]): Plan => ({ ...EMPTY_PLAN, planned_home: HOME, items });
const fenced: Plan = { ...planOf(waypoint(10)), fence: [{ shape: 'polygon', inclusion: true, polygon: [at(-50, -50), at(50, -50), at(50, 50), at(-50, 50)] }] };

describe('history', () => {
  it('undoes and redoes each change', () => {
    let edited = history.begin(0);
    for (const next of [1, 2]) edited = history.change(edited, next);
    edited = history.undo(history.undo(edited));
    expect(edited.present).toBe(0);
    expect(history.undo(edited)).toBe(edited);
    expect(history.redo(history.redo(edited)).present).toBe(2);
  });
  it('undoes all changes of one gesture together', () => {
    let edited = history.begin(0);
    for (const next of [1, 2, 3]) edited = history.change(edited, next, 'drag 1');
    edited = history.change(history.endGroup(edited), 4, 'drag 1');
    expect(history.undo(edited).present).toBe(3);
    expect(history.undo(history.undo(edited)).present).toBe(0);
  });
  it('removes only the changes of a cancelled gesture', () => {
    const edited = history.change(history.change(history.begin(0), 1), 2, 'drag 1');
    expect(history.cancelGroup(edited, 'drag 1')).toMatchObject({ present: 1, future: [] });
    expect(history.cancelGroup(edited, 'drag 2')).toBe(edited);
  });
  it('discards undone changes after a new change', () => {
    const edited = history.change(history.undo(history.change(history.begin(0), 1)), 5);
    expect(history.redo(edited)).toBe(edited);
  });
});

describe('editing', () => {
  it('returns a new plan', () => {
    const before = planOf(waypoint(10), waypoint(20));
    const text = JSON.stringify(before);
    const moved = movePoint(before, 'item:1', at(99));
    expect(JSON.stringify(before)).toBe(text);
    expect(groundDistance_m(positionOf(moved, 'item:1') ?? HOME, at(99))).toBeLessThan(0.01);
  });
  it('adapts the targets of jumps', () => {
    const jump = { ...newItem('jump', null, { value_m: 0, reference: 'home' }), target_index: 1 };
    const plan = planOf(waypoint(10), waypoint(20), jump);
    const target = (edited: Plan) => edited.items.find((item) => item.kind === 'jump')?.['target_index'];
    expect(target(insertItem(plan, 0, waypoint(5)))).toBe(2);
    expect(target(insertItem(plan, 2, waypoint(5)))).toBe(1);
    expect(target(remove(plan, ['item:0']))).toBe(0);
    expect(target(reorder(plan, [1], 0).plan)).toBe(0);
  });
  it('moves items together and returns their new rows', () => {
    const plan = planOf(waypoint(1), waypoint(2), waypoint(3), waypoint(4));
    const { plan: moved, rows } = reorder(plan, [2, 3], 1);
    expect(rows).toEqual([1, 2]);
    expect(moved.items).toEqual([plan.items[0], plan.items[2], plan.items[3], plan.items[1]]);
  });
  it('removes a fence with too few corners', () => {
    expect(remove(fenced, ['corner:0:0']).fence[0]).toMatchObject({ polygon: { length: 3 } });
    expect(remove(fenced, ['corner:0:0', 'corner:0:1']).fence).toEqual([]);
    expect(remove(fenced, ['home']).planned_home).toBeNull();
  });
});

describe('the map', () => {
  it('shows items, midpoints, fence and home, with the selection marked', () => {
    const layer = planLayer({ ...fenced, items: [waypoint(10), waypoint(30)] }, new Set(['item:1']), null, HOME);
    const ids = layer.points.map((point) => point.id);
    expect(ids).toEqual(expect.arrayContaining(['home', 'item:0', 'item:1', 'middle:1', 'corner:0:3', 'side:0:4']));
    expect(layer.points.filter((point) => point.selected).map((point) => point.id)).toEqual(['item:1']);
    const midpoint = layer.points.find((point) => point.id === 'middle:1');
    expect(groundDistance_m(midpoint ?? HOME, at(20))).toBeLessThan(0.01);
  });
  it('shows midpoints of a long plan only beside the selection', () => {
    const plan = planOf(...Array.from({ length: 200 }, (_, i) => waypoint(i * 10)));
    const midpoints = (selected: string[]) => planLayer(plan, new Set(selected), null, HOME).points.filter((point) => point.mark === 'midpoint');
    expect(midpoints([])).toEqual([]);
    expect(midpoints(['item:7']).map((point) => point.id)).toEqual(['middle:7', 'middle:8']);
  });
  it('has the altitudes of items, path and rally points for the 3D view', () => {
    const highItem = { ...waypoint(10), altitude: { value_m: 900, reference: 'amsl' as const } };
    const terrainItem = { ...waypoint(20), altitude: { value_m: 7, reference: 'terrain' as const, resolved_amsl_m: 507 } };
    const layer = planLayer(
      { ...planOf(waypoint(0), highItem, terrainItem), rally_points: [{ ...at(5), altitude: { value_m: 20, reference: 'home' } }] },
      new Set(),
      null,
      HOME,
    );
    const altitudeOf = (id: string) => layer.points.find((point) => point.id === id)?.alt_amsl_m;
    expect(['item:0', 'item:1', 'item:2', 'middle:1', 'rally:0', 'home'].map(altitudeOf)).toEqual([510, 900, 507, 705, 500, 480]);
    expect(layer.lines.find((line) => line.style === 'solid')?.positions.map((position) => position.alt_amsl_m)).toEqual([510, 900, 507]);
    expect(layer.points.find((point) => point.id === 'item:1')?.altitudeText).toBe('900.0 m AMSL');
    expect(layer.points.find((point) => point.id === 'home')).not.toHaveProperty('altitudeText');
    expect(layer.ground).toEqual(HOME);
  });
  it('raises items and rally points within the altitude limits, with their resolved altitudes', () => {
    const terrainItem = { ...waypoint(20), altitude: { value_m: 7, reference: 'terrain' as const, resolved_amsl_m: 507 } };
    const plan = { ...fenced, items: [terrainItem], rally_points: [{ ...at(5), altitude: { value_m: 20, reference: 'home' as const } }] };
    expect(raisePoint(plan, 'item:0', 2.5).items[0]?.altitude).toEqual({ value_m: 9.5, reference: 'terrain', resolved_amsl_m: 509.5 });
    expect(raisePoint(plan, 'item:0', 1e9).items[0]?.altitude?.value_m).toBe(100_000);
    expect(raisePoint(plan, 'rally:0', -3).rally_points[0]?.altitude.value_m).toBe(17);
    for (const id of ['home', 'corner:0:0', 'item:9', 'rally:4']) expect(raisePoint(plan, id, 2)).toBe(plan);
  });
  it('draws circles with their radius', () => {
    const ring = ringOf({ shape: 'circle', inclusion: true, center: at(0), radius_m: 120 });
    for (const corner of ring) expect(groundDistance_m(at(0), corner)).toBeCloseTo(120, 0);
  });
  it('draws no path to a point that the camera looks at', () => {
    const roi = newItem('roi_location', at(500), { value_m: 0, reference: 'home' });
    const layer = planLayer(planOf(waypoint(10), roi, waypoint(20)), new Set(), null, HOME);
    expect(layer.lines.find((line) => line.style === 'solid')?.positions).toHaveLength(2);
    expect(layer.points.find((point) => point.id === 'item:1')?.mark).toBe('cross');
  });
});

describe('the list', () => {
  it('has home, items, fence and rally points', () => {
    const titles = planEntries({ ...fenced, rally_points: [{ ...at(5), altitude: { value_m: 20, reference: 'amsl' } }] }).map(
      (entry) => `${entry.title}|${entry.detail}`,
    );
    expect(titles).toEqual(['Home|480.0 m AMSL', 'Waypoint|30.0 m above home', 'Geofence: stay inside|4 corners', 'Rally point|20.0 m AMSL']);
  });
});

describe('number fields', () => {
  it('accept commas and report errors', () => {
    expect(parseNumber('12,5')).toEqual({ ok: true, value: 12.5 });
    expect(parseNumber('−3')).toEqual({ ok: true, value: -3 });
    expect(parseNumber(' ', { optional: true })).toEqual({ ok: true, value: null });
    expect(parseNumber(' ')).toEqual({ ok: false, problem: 'Enter a number.' });
    expect(parseNumber('ten')).toEqual({ ok: false, problem: '“ten” is not a number.' });
    expect(parseNumber('95', { max: 90, min: -90 })).toEqual({ ok: false, problem: 'Enter a number from -90 to 90.' });
  });
});

describe('fixes', () => {
  const LIMIT = 120;
  const finding = (code: string, row: number | null = null): Finding => ({
    code,
    severity: 'error',
    text: '',
    place: { row, zone: null, rally_point: null, obstacle: null, step: null },
    fix: null,
    limit: LIMIT,
  });
  it('add a take-off at the plan’s start', () => {
    const fix = fixOf(planOf(waypoint(10, 25)), finding('takeoff_missing'), null);
    expect(fix?.plan.items[0]).toMatchObject({ kind: 'takeoff', lat_deg: HOME.lat_deg, altitude: { value_m: 25, reference: 'home' } });
  });
  it('use the vehicle’s home only if it is known', () => {
    const plan = { ...planOf(waypoint(10)), planned_home: null };
    expect(fixOf(plan, finding('home_missing'), null)).toBeNull();
    expect(fixOf(plan, finding('home_missing'), HOME)?.plan.planned_home).toEqual(HOME);
  });
  it('set the altitude of a point that is too high to the limit', () => {
    expect(fixOf(planOf(waypoint(10, 500)), finding('altitude_too_high', 0), null)?.plan.items[0]?.altitude).toEqual({ value_m: LIMIT, reference: 'home' });
  });
  it('return null if a person has to decide', () => {
    expect(fixOf(planOf(waypoint(10)), finding('fence_violation', 0), HOME)).toBeNull();
  });
});

describe('the altitude profile', () => {
  it('starts at home and has the horizontal distance of each point', () => {
    const shape = profile(planOf(waypoint(100, 40), waypoint(300, 20)));
    expect(shape.points.map((point) => [point.row, Math.round(point.distance_m), point.alt_home_m])).toEqual([
      [-1, 0, 0],
      [0, 100, 40],
      [1, 300, 20],
    ]);
    expect([shape.top_m, shape.bottom_m]).toEqual([50, 0]);
    expect(polylines(shape, 300, 100)[0]?.map(({ x, y }) => [Math.round(x), Math.round(y)])).toEqual([
      [0, 100],
      [100, 20],
      [300, 60],
    ]);
  });
  it('has a gap where an altitude cannot be compared with home', () => {
    const amslItem: Item = { ...waypoint(200), altitude: { value_m: 520, reference: 'amsl' } };
    const plan = { ...planOf(waypoint(100), amslItem, waypoint(300)), planned_home: null };
    expect(profile(plan).points.map((point) => point.alt_home_m)).toEqual([30, null, 30]);
    expect(polylines(profile(plan), 300, 100)).toHaveLength(2);
    expect(profile({ ...plan, planned_home: HOME }).points.map((point) => point.alt_home_m)).toEqual([0, 30, 40, 30]);
  });
});

describe('the terrain below a plan', () => {
  it('is within the plot, with a gap where the terrain is not known', () => {
    const plan = planOf(waypoint(100));
    const ground = [
      [0, 0],
      [30, 50],
      [50, null],
      [80, -20],
      [100, -5],
    ] as const;
    const shape = profile(plan, ground);
    expect([shape.top_m, shape.bottom_m]).toEqual([60, -20]);
    const areas = groundAreas(shape, ground, 100, 80);
    expect(areas).toBe('M0.0 80L0.0 60.0L30.0 10.0L30.0 80ZM80.0 80L80.0 80.0L100.0 65.0L100.0 80Z');
  });
  it('must be resolved again for an item that was moved', () => {
    const item = newItem('waypoint', at(0), { value_m: 30, reference: 'terrain', resolved_amsl_m: 510 });
    const moved = movePoint(planOf(item), 'item:0', at(50)).items[0];
    expect(moved).toMatchObject({ altitude: { value_m: 30, resolved_amsl_m: null } });
    expect(movePoint(planOf(waypoint(0)), 'item:0', at(50)).items[0]).toMatchObject({ altitude: { value_m: 30, reference: 'home' } });
  });
});
