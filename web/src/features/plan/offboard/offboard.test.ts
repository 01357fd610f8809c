import { unitText } from '../../../ui/units';
import { describe, expect, it } from 'vitest';
import { groundDistance_m, positionAt } from '../../../vehicle/geo';
import { PlanEditor } from '../editor/editor.svelte';
import type { Finding } from '../document/fixes';
import { addCalledList, addStep, addToBranch, insertPoint, nodeOf, movePoint, raisePoint, remove, reorder } from './edit';
import { fieldsOf, missionFields, pointFields, type Field } from './fields';
import { fixOf } from './fixes';
import type { CompiledFlight } from './mission';
import { nodesOf, assignmentProblem, stepId, type Mission, type MissionPosition, type Step } from './mission';
import { missionLayer, missionEntries } from './mission-layer';
import { addRole, nameProblem, removeRole, renameRole } from './roles';
import { missionFrameOf, movedTo, raisedBy, positionInFrame, geoPointOf, type PositionFrame } from './positions';
import { boundsOf, quantityOf } from '../../../vehicle/fields';
import { detailOf, newMission, newStep, STEP_KINDS, stepTitle } from './step-titles';

const HOME = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const at = (north_m: number, east_m = 0) => positionAt(HOME, { north_m, east_m });
const offset = (north_m: number, east_m: number, up_m: number): MissionPosition => ({ offset_ned_m: [north_m, east_m, -up_m] });
const FLY: Step = { step: 'fly', points: [offset(10, 0, 10), offset(30, 0, 20)] };
const missionOf = (...steps: Step[]): Mission => ({ ...newMission(HOME), steps });
const FRAME = missionFrameOf(missionOf(), null, null);
const NESTED: Mission = {
  ...missionOf(
    newStep('take_off'),
    { step: 'repeat', times: 2, steps: [FLY] },
    { step: 'branch', condition: { value: 'battery_share', above: 0.5 }, then: [{ step: 'call', mission: 'round' }], otherwise: [newStep('land')] },
  ),
  missions: { round: [newStep('orbit'), { step: 'call', mission: 'round' }] },
};
const placesOf = (mission: Mission): string[] => nodesOf(mission).map((node) => node.place);

describe('the steps of a mission', () => {
  it('are a tree with the server’s names, in which recursive calls end', () => {
    expect(placesOf(NESTED)).toEqual([
      'step 1',
      'step 2',
      'step 2.1',
      'step 3',
      'step 3 then 1',
      'step 3 then 1, round 1',
      'step 3 then 1, round 2',
      'step 3 otherwise 1',
    ]);
    expect(nodesOf(NESTED).map((node) => node.depth)).toEqual([0, 0, 1, 0, 1, 2, 2, 1]);
  });

  it('are listed by role for several vehicles; a new step is added to the first role', () => {
    const role = { steps: [newStep('take_off'), newStep('land')] };
    const twoRoles: Mission = { ...missionOf(), roles: { lead: role, left: role } };
    expect(placesOf(twoRoles)).toEqual(['lead, step 1', 'lead, step 2', 'left, step 1', 'left, step 2']);
    expect(nodesOf(twoRoles).map((node) => node.listHeading)).toEqual(['Role lead', '', 'Role left', '']);
    const withHold = addStep(twoRoles, 'hold', null, [], FRAME);
    expect(withHold.mission.steps).toEqual([]);
    expect(withHold.mission.roles?.['lead']?.steps.map((step) => step.step)).toEqual(['take_off', 'hold', 'land']);
    const withMeet = addStep(twoRoles, 'meet', null, [stepId('left, step 1')], FRAME);
    expect(withMeet.id).toBe(stepId('left, step 2'));
    expect(assignmentProblem(['lead', 'left'], { lead: '1' })).toBe('Choose a vehicle for the role “left”.');
    expect(assignmentProblem(['lead', 'left'], { lead: '1', left: '1' })).toContain('two roles');
    expect(assignmentProblem(['lead', 'left'], { lead: '1', left: '2' })).toBeNull();
  });

  it('become the steps of the first role; new roles get its "meet" steps; a last role becomes a mission for one vehicle', () => {
    const oneVehicle = missionOf(newStep('take_off'), FLY, newStep('land'));
    const twoRoles = addRole(oneVehicle);
    expect(twoRoles.steps).toEqual([]);
    expect(twoRoles.roles?.['lead']).toEqual({ start_ned_m: [0, 0, 0], steps: oneVehicle.steps });
    expect(twoRoles.roles?.['wing']?.start_ned_m).toEqual([0, 10, 0]);
    const withMeet = addStep(twoRoles, 'meet', null, [stepId('lead, step 1')], FRAME).mission;
    const threeRoles = addRole(withMeet);
    expect(Object.keys(threeRoles.roles ?? {})).toEqual(['lead', 'wing', 'role 3']);
    expect(threeRoles.roles?.['role 3']?.steps.map((step) => step.step)).toEqual(['take_off', 'meet', 'land']);
    expect(threeRoles.roles?.['role 3']?.start_ned_m).toEqual([0, 20, 0]);
    const renamed = renameRole(threeRoles, 'lead', 'first');
    expect(Object.keys(renamed.roles ?? {})).toEqual(['first', 'wing', 'role 3']);
    expect([nameProblem(threeRoles, 'lead', 'wing'), nameProblem(threeRoles, 'lead', ' '), nameProblem(threeRoles, 'lead', 'lead')]).toEqual([
      'A role named “wing” already exists.',
      'A role needs a name.',
      null,
    ]);
    const single = removeRole(removeRole(renamed, 'role 3'), 'wing');
    expect(single.roles).toBeUndefined();
    expect(single.steps).toEqual(oneVehicle.steps);
  });

  it('have a title for every kind', () => {
    for (const kind of STEP_KINDS) expect(stepTitle(newStep(kind))).not.toBe('');
    expect(detailOf(FLY)).toBe('2 points');
    expect(detailOf(NESTED.steps[2] as Step)).toBe('if battery above 50 %');
    expect(detailOf({ ...newStep('orbit'), turns: 1 })).toBe('radius 10 m · 1 turn');
    expect(detailOf({ ...newStep('helix'), turns: 1, climb_m: -5 })).toContain('descend 5 m');
    expect(detailOf({ ...newStep('helix'), speed_m_s: 3, photo_every_m: 2.5 })).toBe('radius 10 m · 3 turns · climb 10 m · ≤ 3 m/s · photo every 2.5 m');
  });

  it('show durations that contain the durations of nested steps', () => {
    const times = ['step 1', 'step 2.1', 'step 3 otherwise 1'].map((place, i) => ({ place, start_s: 0, duration_s: 60 * (i + 1), length_m: 0, photos: 0 }));
    const durations = Object.fromEntries(
      missionEntries(NESTED, times).flatMap((entry) => (entry.stepPlace === undefined ? [] : [[entry.stepPlace, entry.estimateText]])),
    );
    expect([durations['step 1'], durations['step 2'], durations['step 3'], durations['step 3 then 1']]).toEqual(['1 min 00 s', '2 min 00 s', '3 min 00 s', '']);
  });
});

describe('positions', () => {
  it('are the same point in each of the four frames', () => {
    const frame = { ...FRAME, origin: { ...positionAt(HOME, { north_m: 5, east_m: -3 }), alt_amsl_m: 478 } };
    const geoPoint = { ...at(40, 25), up_m: 12 };
    for (const positionFrame of ['offset', 'home', 'amsl', 'local'] as PositionFrame[]) {
      const converted = geoPointOf(positionInFrame(positionFrame, geoPoint, frame), frame);
      expect(groundDistance_m(converted, geoPoint)).toBeLessThan(0.02);
      expect(converted.up_m).toBeCloseTo(12, 2);
    }
    expect(positionInFrame('local', geoPoint, frame)).toEqual({ position_ned_m: [35, 28, -14] });
  });

  it('keep their frame, altitude and other fields when they are moved', () => {
    expect(movedTo({ ...offset(1, 2, 7.25), stop: true }, at(50, 60), FRAME)).toEqual({ offset_ned_m: [50, 60, -7.25], stop: true });
    expect(movedTo({ lat_deg: 47, lon_deg: 8, alt_home_m: 7 }, at(50), FRAME)).toMatchObject({ alt_home_m: 7, lat_deg: Number(at(50).lat_deg.toFixed(8)) });
  });
});

describe('editing', () => {
  it('moves a point of a nested step, and returns a new mission', () => {
    const text = JSON.stringify(NESTED);
    const moved = movePoint(NESTED, 'point:points:1:step 2.1', at(99), FRAME);
    expect(JSON.stringify(NESTED)).toBe(text);
    expect(nodeOf(moved, 'step:step 2.1')?.step.points?.[1]).toEqual(offset(99, 0, 20));
  });

  it('changes a called step at every call', () => {
    const moved = movePoint(NESTED, 'point:center:0:step 3 then 1, round 1', at(7), FRAME);
    expect(moved.missions['round']?.[0]?.['center']).toEqual(offset(7, 0, 10));
  });

  it('inserts a point with the altitude of the point before', () => {
    const inserted = insertPoint(missionOf(FLY), 'step 1', 1, at(20, 5), FRAME);
    expect(inserted?.mission.steps[0]?.points?.[1]).toEqual(offset(20, 5, 10));
    expect(inserted?.id).toBe('point:points:1:step 1');
  });

  it('removes points, a step without points, and several steps together', () => {
    expect(remove(missionOf(FLY), ['point:points:0:step 1']).steps[0]?.points).toEqual([offset(30, 0, 20)]);
    expect(remove(missionOf(FLY), ['point:points:0:step 1', 'point:points:1:step 1']).steps).toEqual([]);
    expect(placesOf(remove(NESTED, ['step:step 1', 'step:step 2.1', 'step:step 3 otherwise 1']))).toEqual([
      'step 1',
      'step 2',
      'step 2 then 1',
      'step 2 then 1, round 1',
      'step 2 then 1, round 2',
    ]);
  });

  it('adds steps after the selection, keeps a landing last, fills an empty branch', () => {
    const kinds = (mission: Mission) => mission.steps.map((step) => step.step);
    const defaultMission = newMission(HOME);
    expect(kinds(addStep(defaultMission, 'hold', null, [], FRAME).mission)).toEqual(['take_off', 'hold', 'land']);
    expect(kinds(addStep(defaultMission, 'photo', null, ['step:step 1'], FRAME).mission)).toEqual(['take_off', 'photo', 'land']);
    const branch = missionOf({ ...newStep('branch') });
    expect(addStep(branch, 'land', null, ['step:step 1'], FRAME).id).toBe('step:step 1 then 1');
    const [node] = nodesOf(branch);
    expect(node === undefined ? null : addToBranch(branch, node, 'otherwise').id).toBe('step:step 1 otherwise 1');
    const call = missionOf(newStep('call'));
    const [callNode] = nodesOf(call);
    expect(callNode === undefined ? [] : placesOf(addCalledList(call, callNode))).toEqual(['step 1', 'step 1, part 1 1']);
  });

  it('moves steps of one list together', () => {
    const mission = missionOf(newStep('take_off'), newStep('hold'), newStep('photo'), newStep('land'));
    const moved = reorder(mission, ['step:step 2', 'step:step 3'], 1);
    expect(moved?.mission.steps.map((step) => step.step)).toEqual(['take_off', 'land', 'hold', 'photo']);
    expect(moved?.ids).toEqual(['step:step 3', 'step:step 4']);
    expect(reorder(mission, ['step:step 1'], -1)).toBeNull();
    expect(reorder(NESTED, ['step:step 1', 'step:step 2.1'], 1)).toBeNull();
  });

  it('undoes and redoes every change', () => {
    const editor = new PlanEditor();
    editor.beginMission(HOME);
    editor.frame = FRAME;
    for (const north_m of [20, 40]) editor.press(at(north_m));
    editor.stopPlacing();
    expect(editor.mission?.steps.map((step) => step.points?.length ?? 0)).toEqual([0, 2, 0]);
    const states = [editor.mission];
    editor.grab('between:1:step 2');
    editor.drag('', at(30, 10));
    editor.drop(true);
    states.push(editor.mission);
    editor.select(['step:step 3']);
    editor.remove();
    states.push(editor.mission);
    editor.addStep('orbit', at(5));
    editor.undo();
    for (const state of [...states].reverse()) {
      expect(editor.mission).toBe(state);
      editor.undo();
    }
    for (let i = 0; i < 4; i += 1) editor.redo();
    expect(editor.mission?.steps.map((step) => step.step)).toEqual(['take_off', 'fly', 'orbit']);
  });
});

describe('the fields of steps', () => {
  const context = { mission: NESTED, frame: FRAME };
  const fieldNamed = <T>(rows: readonly Field<T>[], name: string): Field<T> => rows.find((row) => row.name === name) as Field<T>;

  it('exist for every kind, and keep a value that is set again', () => {
    for (const kind of STEP_KINDS)
      for (const row of fieldsOf(newStep(kind), context)) {
        const changed = fieldsOf(row.set(newStep(kind), row.value), context).find(({ name }) => name === row.name);
        expect([kind, row.name, changed?.value]).toEqual([kind, row.name, row.value]);
      }
  });

  it('show angles in degrees and fractions in per cent', () => {
    const pitch = fieldNamed(fieldsOf(newStep('gimbal'), context), 'pitch_rad');
    expect([pitch.unit, pitch.value]).toEqual(['°', -45]);
    expect(pitch.set(newStep('gimbal'), -90)['pitch_rad']).toBeCloseTo(-Math.PI / 2);
    const bound = fieldNamed(fieldsOf(newStep('branch'), context), 'condition-bound');
    expect([bound.unit, bound.value]).toEqual(['%', 50]);
    expect(bound.set(newStep('branch'), 30)['condition']).toMatchObject({ above: 0.3 });
  });

  it('remove the value of an emptied field, and all headings but the chosen one', () => {
    const fastStep = { ...FLY, speed_m_s: 3 };
    expect('speed_m_s' in fieldNamed(fieldsOf(fastStep, context), 'speed_m_s').set(fastStep, null)).toBe(false);
    const lookingStep = fieldNamed(fieldsOf(FLY, context), 'heading').set({ ...FLY, yaw_ned_rad: 1 }, 'look_at');
    expect([lookingStep['yaw_ned_rad'], lookingStep['look_at']]).toEqual([undefined, offset(30, 0, 20)]);
    expect(fieldNamed(fieldsOf(newStep('repeat'), context), 'times').set(newStep('repeat'), 2.6)['times']).toBe(3);
  });

  it('exist for a point and for the whole mission', () => {
    const altitude = fieldNamed(pointFields(offset(1, 2, 3), context), 'point-height');
    expect(altitude.value).toBe(3);
    expect(altitude.set(offset(1, 2, 3), 8)).toEqual(offset(1, 2, 8));
    expect(fieldNamed(missionFields(NESTED), 'link_loss').set(NESTED, 'land').actions.link_loss).toBe('land');
    expect(fieldNamed(missionFields(NESTED), 'speed_m_s').set(NESTED, 4).limits.speed_m_s).toBe(4);
  });
  it('offer the kinds of obstacle avoidance, for the mission and for a step', () => {
    const row = (mission: Mission) => fieldNamed(missionFields(mission), 'avoidance');
    expect(row(NESTED).options?.map(({ value }) => value)).toEqual(['off', 'over', 'around']);
    expect([false, true, 'over', 'around'].map((value) => row({ ...NESTED, avoidance: value as Mission['avoidance'] }).value)).toEqual([
      'off',
      'over',
      'over',
      'around',
    ]);
    expect(['off', 'around'].map((value) => row(NESTED).set(NESTED, value).avoidance)).toEqual([false, 'around']);
    const stepRow = (step: Step) => fieldNamed(fieldsOf(step, context), 'avoidance');
    expect([null, true, false, 'around'].map((value) => stepRow({ ...FLY, avoidance: value }).value)).toEqual(['', 'over', 'off', 'around']);
    expect(['', 'off', 'over'].map((value) => stepRow(FLY).set(FLY, value)['avoidance'])).toEqual([null, false, 'over']);
  });
  it('include all limits of a mission, with bounds that the server accepts', () => {
    const rad = (deg = 0) => (deg * Math.PI) / 180;
    const rows = missionFields(NESTED).filter(({ name }) => /_(m_s|m_s2|m_s3|rad|rad_s)$/.test(name));
    expect(rows.map(({ label, unit }) => `${label} [${unitText(unit ?? '')}]`)).toEqual([
      'Maximum speed [m/s]',
      'Maximum climb speed [m/s]',
      'Maximum descent speed [m/s]',
      'Maximum acceleration [m/s²]',
      'Maximum jerk [m/s³]',
      'Maximum tilt [°]',
      'Maximum yaw rate [°/s]',
    ]);
    const rate = fieldNamed(missionFields(NESTED), 'yaw_rate_rad_s');
    expect(rate.set(NESTED, 90).limits.yaw_rate_rad_s).toBeCloseTo(Math.PI / 2);
    expect(rate.set(rate.set(NESTED, 90), null).limits.yaw_rate_rad_s).toBeUndefined();
    const tilt = fieldNamed(missionFields(NESTED), 'tilt_rad');
    for (const [{ min, max }, serverMin, serverMax] of [
      [rate, 0.05, 10],
      [tilt, 0.05, 1.55],
    ] as const) {
      expect(rad(min)).toBeGreaterThanOrEqual(serverMin);
      expect(rad(max)).toBeLessThanOrEqual(serverMax);
    }
  });
});

describe('the map of a mission', () => {
  const leg = (place: string, main: boolean, ...points: [number, number, number, number][]) => ({
    place,
    title: '',
    start_s: 0,
    duration_s: 1,
    main,
    role: null,
    points,
  });
  const flight = {
    legs: [
      leg('step 1', true, [0, 0, 0, 0], [1, 10, 0, -5]),
      leg('step 2', true, [0, 10, 0, -5], [1, 20, 0, -5]),
      leg('step 3', false, [0, 20, 0, -5], [1, 20, 9, -5]),
    ],
  };

  it('has points with letters, midpoints, and the compiled path', () => {
    const layer = missionLayer(missionOf(newStep('take_off'), FLY), new Set(['point:points:1:step 2']), null, FRAME, flight as unknown as CompiledFlight, true);
    expect(layer.points.filter((point) => point.mark === 'disc').map((point) => [point.text, point.selected])).toEqual([
      ['2a', false],
      ['2b', true],
    ]);
    expect(layer.points.map((point) => point.id)).toContain('between:1:step 2');
    expect(layer.lines.map((line) => [line.style, line.positions.length])).toEqual([
      ['solid', 3],
      ['dotted', 2],
    ]);
  });

  it('has the path of each role in its own colour', () => {
    const twoRoles = { ...missionOf(), steps: [], roles: { lead: { steps: [newStep('land')] }, left: { steps: [newStep('land')] } } };
    const legs = [
      { ...leg('lead, step 1', true, [0, 0, 0, 0], [1, 0, 0, -5]), role: 'lead' },
      { ...leg('left, step 1', true, [0, 0, 0, -5], [1, 9, 0, -5]), role: 'left' },
    ];
    const layer = missionLayer(twoRoles, new Set(), null, FRAME, { legs } as unknown as CompiledFlight, true);
    expect(layer.lines.map(({ tone }) => tone)).toEqual(['target', 'id2']);
  });

  it('has altitudes for the 3D view, from the start and along the compiled path', () => {
    const layer = missionLayer(missionOf(newStep('take_off'), FLY), new Set(), null, FRAME, flight as unknown as CompiledFlight, true);
    const { start, origin } = FRAME;
    const [first] = layer.points.filter((point) => point.mark === 'disc');
    expect(first?.alt_amsl_m).toBeCloseTo(start.alt_amsl_m + geoPointOf(FLY.points?.[0] ?? {}, FRAME).up_m, 6);
    expect(first?.altitudeText).toMatch(/^-?[\d.]+ m above/);
    expect(layer.lines[0]?.positions.map((position) => (position.alt_amsl_m ?? 0) - origin.alt_amsl_m)).toEqual([0, 5, 5]);
    expect(layer.ground).toEqual(start);
  });

  it('raises a point in its own frame', () => {
    expect(raisedBy({ offset_ned_m: [1, 2, -10], hold_s: 3 }, 2.5)).toEqual({ offset_ned_m: [1, 2, -12.5], hold_s: 3 });
    expect(raisedBy({ position_ned_m: [1, 2, -10] }, -2)).toEqual({ position_ned_m: [1, 2, -8] });
    expect(raisedBy({ lat_deg: 47, lon_deg: 8, alt_home_m: 10 }, 0.1)).toMatchObject({ alt_home_m: 10.1 });
    expect(raisedBy({ lat_deg: 47, lon_deg: 8, alt_amsl_m: 500 }, -0.5)).toMatchObject({ alt_amsl_m: 499.5 });
    const mission = missionOf(newStep('take_off'), FLY);
    const up_m = (edited: typeof mission, index: number) => geoPointOf(edited.steps[1]?.points?.[index] ?? {}, FRAME).up_m;
    const raised = raisePoint(mission, 'point:points:1:step 2', 4);
    expect([up_m(raised, 0), up_m(raised, 1)]).toEqual([up_m(mission, 0), up_m(mission, 1) + 4]);
    expect(raisePoint(mission, 'home', 4)).toBe(mission);
  });

  it('connects the points by straight lines until the server has compiled the path', () => {
    expect(missionLayer(missionOf(FLY), new Set(), null, FRAME, null, false).lines).toMatchObject([{ style: 'dotted', positions: { length: 3 } }]);
  });
});

describe('fixes of a mission', () => {
  const LIMIT = 120.5;
  const finding = (code: string, step: string | null = null): Finding => ({
    code,
    severity: 'error',
    text: '',
    place: { row: null, zone: null, rally_point: null, obstacle: null, step },
    fix: null,
    limit: LIMIT,
  });
  it('add missing steps and lower points that are too high', () => {
    expect(fixOf(missionOf(FLY), finding('takeoff_missing', 'step 1'), FRAME)?.plan.steps[0]?.step).toBe('take_off');
    expect(fixOf(missionOf(FLY), finding('landing_missing', 'the end'), FRAME)?.plan.steps.at(-1)?.step).toBe('land');
    const highMission = missionOf({ step: 'fly', points: [offset(1, 2, 300), offset(1, 2, 30)] });
    expect(fixOf(highMission, finding('altitude_too_high', 'step 1'), FRAME)?.plan.steps[0]?.points).toEqual([offset(1, 2, 120), offset(1, 2, 30)]);
    expect(stepId('step 1')).toBe('step:step 1');
  });
  it('return null if a person has to decide', () => {
    expect(fixOf(missionOf(FLY), finding('fence_crossed', 'step 1'), FRAME)).toBeNull();
  });
});

describe('the numbers of the editor', () => {
  it.each(STEP_KINDS)('of a %s step are those that the API accepts', (kind) => {
    for (const field of fieldsOf(newStep(kind), { mission: newMission(null), frame: FRAME })) {
      const { min, max, above } = quantityOf(field.name, boundsOf(`step_${kind}`, field.name));
      if (field.type !== 'number' || (min ?? max ?? above) === undefined) continue;
      expect([field.min ?? -Infinity, -(field.max ?? Infinity), field.above ?? -Infinity], field.name).toEqual([
        expect.toSatisfy((shown: number) => shown >= (min ?? -Infinity)),
        expect.toSatisfy((shown: number) => shown >= -(max ?? Infinity)),
        expect.toSatisfy((shown: number) => shown >= (above ?? -Infinity)),
      ]);
    }
  });
});
