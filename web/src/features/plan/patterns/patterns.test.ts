import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../../api/client';
import { positionAt } from '../../../vehicle/geo';
import { PlanApi } from '../api';
import { EMPTY_PLAN, isPatternItem, type Altitude, type Item, type Pattern } from '../document/document';
import { isStale, ringsOf } from '../document/pattern-items';
import { PlanEditor } from '../editor/editor.svelte';
import { newItem } from '../document/items';
import { GROUND_TOLERANCE_M, PatternDrawing } from './drawing.svelte';
import { areaText } from '../../../ui/format';
import { figuresOf } from './shape';
import { linesOnPath, patternLayer } from './pattern-layer';
import { PATTERN_KINDS, missingPoints, pointChoices, PATTERNS, rectangle, usableRings, type PatternKind } from './shape';
import { PatternUpdates } from './updates.svelte';
import { DEFAULT_VALUES, problemPlaceOf, requestOf, sectionsOf, valuesOf, withRow, type PatternValues, type RowName } from './values';

const HOME = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const at = (north_m: number, east_m = 0) => positionAt(HOME, { north_m, east_m });
const AREA = [at(0, 0), at(50, 0), at(50, 80), at(0, 80)];
const HOLE = [at(10, 10), at(20, 10), at(20, 20)];
const FIGURES = {
  lines_length_m: 400,
  lower_bound_m: 390,
  photos: 41,
  spacing_m: 21,
  trigger_m: 10,
  resolution_m_px: 0.01096,
  heading_deg: 90,
  area_m2: 40_000,
  length_m: 512.4,
  time_s: 125,
};
const AT_40_M: Altitude = { value_m: 40, reference: 'home' };
const WAYPOINTS = [at(0), at(0, 80)].map((place) => newItem('waypoint', place, AT_40_M));
const GENERATED = {
  plan: { ...EMPTY_PLAN, items: WAYPOINTS },
  path: [at(0), at(0, 80)].map((place) => ({ ...place, altitude: AT_40_M })),
  lines: [[at(0), at(0, 80)]],
  figures: FIGURES,
  notes: [],
};
const STEPS = ['To survey line 1', 'Survey line 1'].map((name) => ({ step: 'fly', name, points: [{ lat_deg: 47.4, lon_deg: 8.5, alt_home_m: 40 }] }));

type FakeResponse = readonly [number, unknown];

/** A drawing with a fake server, which gives these responses in order and records the requests. */
function drawingWith(kind: PatternKind, ...responses: readonly FakeResponse[]) {
  const requests: { url: string; body: Record<string, unknown> }[] = [];
  const api = new ApiClient('p', undefined, (url, init) => {
    const [status, body] = responses[requests.length] ?? [500, {}];
    requests.push({ url, body: JSON.parse(init.body as string) as Record<string, unknown> });
    return Promise.resolve(new Response(JSON.stringify(body), { status }));
  });
  const stored = new Map<string, string>();
  const storage = { getItem: (key: string) => stored.get(key) ?? null, setItem: (key: string, value: string) => void stored.set(key, value) };
  const editor = new PlanEditor();
  editor.begin(HOME);
  const drawing = new PatternDrawing(new PlanApi(api), editor, storage);
  drawing.begin(kind);
  return { drawing, editor, requests, storage, api };
}

/** A survey of AREA in a plan, with its items, between a take-off and a jump to the landing. */
const SURVEY: Pattern = (() => {
  const made = requestOf('survey', [AREA], DEFAULT_VALUES);
  if (!made.ok) throw new Error(made.problem.text);
  return made.pattern;
})();
const surveyItem = (items_key: string, items: readonly Item[] = WAYPOINTS): Item => ({ kind: 'pattern', pattern: SURVEY, items, items_key, original: null });
const answer = (items_key: string, count: number): FakeResponse => [
  200,
  {
    ...GENERATED,
    plan: {
      ...EMPTY_PLAN,
      items: [
        surveyItem(
          items_key,
          Array.from({ length: count }, () => WAYPOINTS[0] as Item),
        ),
      ],
    },
  },
];

function editing(...responses: readonly FakeResponse[]) {
  const made = drawingWith('survey', ...responses);
  const { editor, drawing, api } = made;
  drawing.cancel();
  const jump: Item = { ...newItem('jump', null, AT_40_M), target_index: 3, repeat: 1 };
  editor.change({ ...editor.plan, items: [newItem('takeoff', HOME, AT_40_M), surveyItem('k1'), newItem('land', HOME, AT_40_M), jump] });
  const survey = () => {
    const item = editor.plan.items[1];
    if (!isPatternItem(item)) throw new Error('no pattern');
    return item;
  };
  return { ...made, survey, updates: new PatternUpdates(new PlanApi(api), editor) };
}

describe('a pattern of the plan', () => {
  it('is edited by its form: each change is a change of the plan, and its lines follow', async () => {
    const { drawing, editor, survey, requests } = editing(answer('k1', 2), answer('k2', 5));
    drawing.edit(1);
    expect([drawing.kind, drawing.rings, drawing.values.heading_deg]).toEqual(['survey', [AREA], null]);
    await drawing.refresh();
    expect([survey().items.length, isStale(survey())]).toEqual([2, false]); // the preview changes nothing
    drawing.set('heading_deg', 30);
    expect(survey().pattern).toMatchObject({ heading_deg: 30 });
    expect(isStale(survey())).toBe(true);
    await drawing.refresh();
    expect(requests[1]?.body).toMatchObject({ heading_deg: 30 });
    expect([survey().items.length, isStale(survey())]).toEqual([5, false]);
    expect(editor.plan.items[3]?.['target_index']).toBe(6); // still the landing
    editor.undo();
    drawing.sync();
    expect([survey().items.length, drawing.values.heading_deg, editor.plan.items[3]?.['target_index']]).toEqual([2, null, 3]);
    editor.redo();
    drawing.sync();
    expect([survey().items.length, drawing.values.heading_deg]).toEqual([5, 30]);
  });

  it('is changed by a drag of a corner as one step of the history', () => {
    const { drawing, editor, survey } = editing();
    drawing.edit(1);
    drawing.grab('shape:0:2');
    drawing.drag('shape:0:2', at(60, 90));
    drawing.drag('shape:0:2', at(70, 95));
    drawing.drop(true);
    expect(survey().pattern).toMatchObject({ outer: [AREA[0], AREA[1], at(70, 95), AREA[3]] });
    editor.undo();
    expect(survey().pattern).toEqual(SURVEY);
    drawing.sync();
    drawing.grab('shape:0:1');
    drawing.drag('shape:0:1', at(60, 0));
    drawing.drop(false);
    expect(survey().pattern).toEqual(SURVEY);
  });

  it('keeps its lines while its shape is not complete', () => {
    const { drawing, survey } = editing();
    drawing.edit(1);
    for (const index of [3, 2]) {
      drawing.selectPoint({ ring: 0, index });
      drawing.remove();
    }
    expect(drawing.missingPointCount).toBe(1);
    expect(survey().pattern).toMatchObject({ outer: AREA.slice(0, 3) });
  });

  it('is taken apart as one change, with jumps to the same items', () => {
    const { drawing, editor } = editing();
    drawing.edit(1);
    drawing.takeApart();
    expect(editor.plan.items.map(({ kind }) => kind)).toEqual(['takeoff', 'waypoint', 'waypoint', 'land', 'jump']);
    expect([drawing.kind, editor.plan.items[4]?.['target_index']]).toEqual([null, 3]);
    editor.undo();
    expect(editor.plan.items[1]?.kind).toBe('pattern');
  });

  it('moves as a whole with its number on the map, and gets its lines from the server', async () => {
    const { editor, survey, updates, requests } = editing(answer('k3', 3));
    expect(editor.content.points.find(({ id }) => id === 'item:1')).toMatchObject({ text: '2' });
    editor.grab('item:1');
    editor.drag('item:1', at(100, 0));
    editor.drop(true);
    expect(survey().pattern).not.toEqual(SURVEY);
    expect(updates.next).toBe(survey());
    await updates.update(survey(), null);
    expect((requests[0]?.body['outer'] as { lat_deg: number }[])[0]?.lat_deg).toBeCloseTo(at(100).lat_deg, 6);
    expect([survey().items.length, updates.next]).toEqual([3, null]);
  });

  it('says why it has no lines, and is not requested again until it is changed', async () => {
    const { editor, survey, updates } = editing([422, { code: 'invalid_request', field: 'outer', detail: 'the area: too small.', remedy: 'Draw it larger.' }]);
    editor.grab('item:1');
    editor.drag('item:1', at(100, 0));
    editor.drop(true);
    await updates.update(survey(), null);
    expect([updates.problemOf(survey()), updates.next]).toEqual(['The area: too small. Draw it larger.', null]);
  });

  it('disappears with an undo of its insertion, and its form with it', () => {
    const { drawing, editor } = editing();
    drawing.edit(1);
    editor.undo();
    drawing.sync();
    expect(drawing.kind).toBeNull();
  });
});

describe('the shape of a pattern', () => {
  it('is drawn by clicks, corrected by drags and midpoints, and reduced by Delete', () => {
    const { drawing } = drawingWith('survey');
    for (const [count, corner] of AREA.slice(0, 3).entries()) {
      expect(drawing.missingPointCount).toBe(3 - count);
      drawing.press(corner);
    }
    expect(drawing.missingPointCount).toBe(0);
    expect(drawing.grab('between:0:3')).toBe('shape:0:3');
    drawing.drag('shape:0:3', at(0, 80));
    drawing.drop(true);
    expect(drawing.rings[0]?.[3]).toEqual(at(0, 80));
    drawing.grab('shape:0:0');
    drawing.drag('shape:0:0', at(99, 99));
    drawing.drop(false);
    expect(drawing.rings[0]?.[0]).toEqual(at(0, 0));
    drawing.pick('shape:0:3');
    expect(drawing.remove()).toBe(true);
    expect(drawing.rings[0]).toHaveLength(3);
    expect(drawing.selected).toEqual({ ring: 0, index: 2 });
  });

  it('has holes; clicks add corners to the hole or outline of the selected corner', () => {
    const { drawing } = drawingWith('survey');
    drawing.replaceShape(AREA);
    drawing.addHole();
    expect(drawing.missingPointCount).toBe(0);
    for (const corner of HOLE) drawing.press(corner);
    expect(drawing.rings.map((ring) => ring.length)).toEqual([4, 3]);
    expect(pointChoices(drawing.rings, 'area').at(-1)).toEqual({ value: '1:2', text: 'Hole 1, corner 3' });
    drawing.selectPoint({ ring: 0, index: 0 });
    drawing.press(at(-10, 0));
    expect(drawing.rings.map((ring) => ring.length)).toEqual([5, 3]);
    for (let i = 0; i < 3; i += 1) {
      drawing.selectPoint({ ring: 1, index: 0 });
      drawing.remove();
    }
    expect(drawing.rings).toHaveLength(1);
  });

  it('is reduced to the part that another kind of pattern can use', () => {
    expect(usableRings([AREA, HOLE], 'survey')).toEqual([AREA, HOLE]);
    expect(usableRings([AREA, HOLE], 'perimeter')).toEqual([AREA]);
    expect(usableRings([AREA], 'orbit')).toEqual([[AREA[0]]]);
    const { drawing } = drawingWith('orbit');
    drawing.press(at(1));
    drawing.press(at(2));
    expect(drawing.rings).toEqual([[at(2)]]);
  });

  it('can be entered as a rectangle with exact coordinates', () => {
    const { drawing } = drawingWith('survey');
    drawing.replaceShape(rectangle(HOME, 60, 40));
    expect([drawing.missingPointCount, drawing.selectedPosition?.lat_deg]).toEqual([0, at(40).lat_deg]);
    drawing.moveTo({ lat_deg: 47.5, lon_deg: 8.4 });
    expect(drawing.rings[0]?.[0]).toEqual({ lat_deg: 47.5, lon_deg: 8.4 });
  });

  it('has a closed outline and the path on the map, or a circle for an orbit', () => {
    const content = patternLayer([AREA], 'area', { ring: 0, index: 1 }, GENERATED as never, true, null, HOME);
    expect(content.lines.map(({ style, positions }) => [style, positions.length])).toEqual([
      ['dashed', 5],
      ['dotted', 2],
      ['solid', 2],
    ]);
    expect(content.points.filter((point) => point.selected).map(({ id }) => id)).toEqual(['shape:0:1']);
    expect(patternLayer([[at(0)]], 'point', null, null, false, 30, HOME).lines).toMatchObject([{ style: 'dashed', positions: { length: 73 } }]);
  });
});

describe('a pattern in the 3D view', () => {
  it('has its path and its lines at their altitudes, above the home of the plan', async () => {
    const { drawing, editor } = drawingWith('survey', [200, GENERATED]);
    editor.frame = { start: HOME, origin: HOME, isStartKnown: true };
    drawing.replaceShape(AREA);
    await drawing.refresh();
    expect(drawing.content?.ground).toEqual(HOME);
    const altitudes = drawing.content?.lines.map(({ positions }) => positions.map((position) => position.alt_amsl_m));
    expect(altitudes).toEqual([Array(5).fill(undefined), [520, 520], [520, 520]]);
  });

  it('has rounds at several altitudes above sea level', () => {
    const path = [20, 30].flatMap((value_m) => AREA.map((place) => ({ ...place, altitude: { value_m, reference: 'amsl' } })));
    const content = patternLayer([AREA], 'area', null, { ...GENERATED, path, lines: [] } as never, true, null, HOME);
    expect(content.lines.at(-1)?.positions.map(({ alt_amsl_m }) => alt_amsl_m)).toEqual([20, 20, 20, 20, 30, 30, 30, 30]);
  });

  it('is on the ground at its own position while the plan has no position', () => {
    const { drawing, editor } = drawingWith('survey');
    editor.begin(null);
    drawing.replaceShape(AREA);
    expect(drawing.content?.ground).toEqual({ ...AREA[0], alt_amsl_m: 0 });
  });

  it('has lines that follow the ground like the path, up to the last photo', () => {
    const path = [at(0, -10), at(0), at(0, 40), at(0, 90), at(20, 90), at(20, 0)].map((place, i) => ({ ...place, alt_amsl_m: 500 + 10 * i }));
    const lines = linesOnPath(path, [
      [at(0), at(0, 80)],
      [at(20, 90), at(20, 45)],
      [at(70), at(70, 9)],
    ]);
    const rounded = lines.map((line) => line.map(({ alt_amsl_m }) => (alt_amsl_m === undefined ? null : Math.round(alt_amsl_m))));
    expect(rounded).toEqual([
      [510, 520, 528],
      [540, 545],
      [null, null],
    ]);
    expect(lines[0]?.at(-1)).toMatchObject(at(0, 80));
  });
});

describe('the settings of a pattern', () => {
  const request = (kind: PatternKind, changes: Partial<PatternValues> = {}) => requestOf(kind, [AREA, HOLE], { ...DEFAULT_VALUES, ...changes });

  it('become a pattern of the API', () => {
    expect(request('survey', { orientation: 'portrait', heading_deg: 30, crosshatch: true, speed_m_s: 4 })).toEqual({
      ok: true,
      pattern: {
        kind: 'survey',
        outer: AREA,
        holes: [HOLE],
        altitude: { value_m: 40, reference: 'home' },
        coverage: {
          camera: { sensor_width_mm: 13.2, sensor_height_mm: 8.8, focal_length_mm: 8.8, image_width_px: 5472, image_height_px: 3648, landscape: false },
          distance_m: 40,
          front_overlap: 0.75,
          side_overlap: 0.65,
          spacing_m: null,
          trigger_m: null,
        },
        heading_deg: 30,
        turnaround_m: 0,
        crosshatch: true,
        speed_m_s: 4,
      },
    });
    expect(request('orbit', { direction: 'counterclockwise', look_at_m: 5 })).toMatchObject({ pattern: { clockwise: false, look_at: { value_m: 5 } } });
    expect(request('orbit', { looks_at_center: false })).toMatchObject({ pattern: { look_at: null } });
    expect(request('structure', { order: 'down', structure_distance_m: 12 })).toMatchObject({ pattern: { from_top: true, coverage: { distance_m: 12 } } });
    expect(request('corridor')).toMatchObject({ pattern: { points: AREA, width_m: 50 } });
    expect(request('perimeter', { offset_m: -5 })).toMatchObject({ pattern: { outer: AREA, offset_m: -5, rounds: 1 } });
  });

  it('are refused by the page if the distance from camera to ground is missing or not above 0', () => {
    expect(request('survey', { reference: 'amsl' })).toMatchObject({ ok: false, problem: { place: 'distance_m' } });
    expect(request('survey', { reference: 'amsl', distance_m: 50 })).toMatchObject({ ok: true });
    expect(request('corridor', { altitude_m: -3 })).toMatchObject({ ok: false, problem: { place: 'altitude_m' } });
    expect(request('perimeter', { reference: 'amsl', altitude_m: -3 })).toMatchObject({ ok: true });
  });

  it('all have a row in the form of at least one pattern', () => {
    const forms = [DEFAULT_VALUES, { ...DEFAULT_VALUES, has_camera: false }];
    const shown = new Set(
      forms.flatMap((values) => PATTERN_KINDS.flatMap((kind) => sectionsOf(kind, values))).flatMap(({ rows }) => rows.map(({ name }) => name)),
    );
    // “has_camera” is one of the choices of “camera”
    expect([...shown, 'has_camera'].sort()).toEqual([...Object.keys(DEFAULT_VALUES), 'camera'].sort());
  });

  it('are those of a pattern of the plan again', () => {
    const other: PatternValues = {
      ...DEFAULT_VALUES,
      altitude_m: 33,
      front_percent: 57,
      side_percent: 29,
      orientation: 'portrait',
      heading_deg: 12,
      layers: 3,
      entrance_m: 45,
      order: 'down',
      rounds: 2,
      direction: 'counterclockwise',
    };
    for (const values of [
      other,
      { ...other, distance_m: 20 },
      { ...other, has_camera: false, spacing_m: 9, trigger_m: 0 },
      { ...other, looks_at_center: false },
    ])
      for (const kind of PATTERN_KINDS) {
        const made = requestOf(kind, [AREA], values);
        if (!made.ok) throw new Error(made.problem.text);
        expect(requestOf(kind, ringsOf(made.pattern), valuesOf(made.pattern, DEFAULT_VALUES)), kind).toEqual(made);
      }
  });

  it('show a camera of the list, or "other" for other values', () => {
    const cameraRow = (values: PatternValues) =>
      sectionsOf('survey', values)
        .flatMap(({ rows }) => rows)
        .find(({ name }) => name === 'camera')?.field.value;
    const fullFrame = withRow(DEFAULT_VALUES, 'camera', 'Full frame, 42 MP, 35 mm');
    expect([fullFrame.sensor_width_mm, cameraRow(fullFrame)]).toEqual([35.9, 'Full frame, 42 MP, 35 mm']);
    expect(cameraRow(withRow(fullFrame, 'focal_length_mm', 50))).toBe('other');
    expect(withRow(fullFrame, 'rounds', 2.6).rounds).toBe(3);
  });

  it.each<[PatternKind, string | null, RowName | 'shape' | null]>([
    ['survey', 'outer', 'shape'],
    ['survey', 'holes', 'shape'],
    ['survey', 'coverage.side_overlap', 'side_percent'],
    ['survey', 'coverage.camera.focal_length_mm', 'focal_length_mm'],
    ['survey', 'coverage', 'side_percent'],
    ['survey', 'coverage.distance_m', 'distance_m'],
    ['structure', 'coverage.distance_m', 'structure_distance_m'],
    ['structure', 'base', 'base_m'],
    ['orbit', 'radius_m', 'radius_m'],
    ['orbit', 'look_at.value_m', 'look_at_m'],
    ['perimeter', 'body', null],
    ['perimeter', null, null],
  ])('show a problem of a %s in %s beside %s', (kind, field, place) => expect(problemPlaceOf(kind, field)).toBe(place));
});

describe('the preview of a pattern', () => {
  it('shows the figures before the insertion, and is inserted as one change', async () => {
    const { drawing, editor, requests } = drawingWith('survey', [200, GENERATED]);
    editor.addItem('takeoff', HOME);
    editor.addItem('return_home', null);
    editor.select([]);
    const before = editor.plan;
    drawing.vehicle = '7';
    drawing.replaceShape(AREA);
    await drawing.refresh();
    expect(requests[0]?.url).toBe('/api/v1/plans/pattern?document=waypoint_plan&vehicle=7');
    expect(drawing.isCurrent).toBe(true);
    expect(figuresOf(FIGURES, PATTERNS.survey.spacingLabel).map(({ value }) => value)).toEqual([
      '512 m',
      '2 min 05 s',
      '41',
      '1.10 cm/px',
      '4.00 ha',
      '10.0 m',
      '21.0 m',
      '90°',
    ]);
    expect(editor.plan).toBe(before);
    expect(await drawing.insert()).not.toBeNull();
    expect(requests).toHaveLength(1);
    expect(editor.plan.items.map((item) => item.kind)).toEqual(['takeoff', 'waypoint', 'waypoint', 'return_home']);
    expect([...editor.selected]).toEqual(['item:1', 'item:2']);
    expect([drawing.kind, drawing.rings]).toEqual([null, [[]]]);
    editor.undo();
    expect(editor.plan).toEqual(before);
    editor.redo();
    expect(editor.plan.items).toHaveLength(4);
  });

  it('is inserted as steps into an offboard mission, before the landing', async () => {
    const { drawing, editor, requests } = drawingWith('survey', [
      200,
      { ...GENERATED, plan: { format: 'offboard-gcs-mission', name: 'Survey', steps: STEPS } },
    ]);
    editor.beginMission(HOME);
    drawing.begin('survey');
    drawing.replaceShape(AREA);
    await drawing.insert();
    expect(requests[0]?.url).toBe('/api/v1/plans/pattern?document=offboard_mission');
    expect(editor.mission?.steps.map(({ step, name }) => name ?? step)).toEqual(['take_off', 'To survey line 1', 'Survey line 1', 'land']);
    expect([...editor.selected]).toEqual(['step:step 2', 'step:step 3']);
    editor.undo();
    expect(editor.mission?.steps).toHaveLength(2);
  });

  it('has the reason of a refusal beside its field, and is then not inserted', async () => {
    const refusal = { code: 'invalid_request', field: 'outer', detail: 'the area: its sides cross or touch.', remedy: 'Move its corners.' };
    const { drawing, editor } = drawingWith('survey', [422, refusal], [200, GENERATED]);
    const before = editor.plan;
    drawing.replaceShape(AREA);
    expect(await drawing.insert()).toBeNull();
    expect(drawing.problem).toEqual({ place: 'shape', text: 'The area: its sides cross or touch. Move its corners.' });
    expect(editor.plan).toBe(before);
    drawing.moveTo(at(-5, 0));
    expect(drawing.problem).toBeNull();
    await drawing.refresh();
    expect(drawing.generated?.figures.photos).toBe(41);
  });

  it('is the response to the newest request', async () => {
    const { drawing } = drawingWith('survey', [200, GENERATED], [200, { ...GENERATED, figures: { ...FIGURES, photos: 5 } }]);
    drawing.replaceShape(AREA);
    const firstRefresh = drawing.refresh();
    drawing.set('altitude_m', 60);
    await Promise.all([firstRefresh, drawing.refresh()]);
    expect([drawing.isCurrent, drawing.busy, drawing.generated?.figures.photos]).toEqual([true, false, 5]);
  });

  it('follows the ground if the altitude is above terrain', async () => {
    const { drawing, requests } = drawingWith('perimeter', [200, GENERATED]);
    drawing.replaceShape(AREA);
    drawing.set('reference', 'terrain');
    await drawing.refresh();
    expect(requests[0]?.url).toContain(`tolerance_m=${GROUND_TOLERANCE_M}`);
  });

  it('is not requested while the shape is incomplete; the camera is stored for the next load of the page', async () => {
    const { drawing, requests, storage, api, editor } = drawingWith('survey');
    drawing.press(at(0));
    await drawing.refresh();
    expect([requests.length, missingPoints(drawing.rings, 'area')]).toEqual([0, 2]);
    drawing.set('camera', 'Full frame, 42 MP, 35 mm');
    expect(new PatternDrawing(new PlanApi(api), editor, storage).values.focal_length_mm).toBe(35);
    storage.setItem('gcs.pattern-camera', '{');
    expect(new PatternDrawing(new PlanApi(api), editor, storage).values).toEqual(DEFAULT_VALUES);
  });
});

it('an area is shown in m², ha or km², depending on its size', () => {
  expect([420, 25_000, 2_500_000].map(areaText)).toEqual(['420 m²', '2.50 ha', '2.50 km²']);
  expect(Object.keys(PATTERNS)).toEqual(['survey', 'corridor', 'perimeter', 'orbit', 'structure']);
});
