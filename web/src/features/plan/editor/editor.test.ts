import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../../api/client';
import { groundDistance_m, positionAt } from '../../../vehicle/geo';
import { PlanApi, type PlanVersion } from '../api';
import { DEFAULT_CONDITIONS } from '../dry-run/conditions';
import * as edit from '../document/edit';
import { EMPTY_PLAN, positionOf } from '../document/document';
import { PlanEditor } from './editor.svelte';
import { Plans } from '../plans.svelte';

const HOME = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const at = (north_m: number, east_m = 0) => positionAt(HOME, { north_m, east_m });

function editorWithWaypoints(): PlanEditor {
  const editor = new PlanEditor();
  editor.begin(HOME);
  for (const north_m of [10, 20, 30]) editor.press(at(north_m));
  return editor;
}
const north_m = (editor: PlanEditor, id: string): number => Math.round(groundDistance_m(HOME, positionOf(editor.plan, id) ?? HOME));

describe('the editor', () => {
  it('adds a waypoint after the selected waypoint with each click', () => {
    const editor = editorWithWaypoints();
    expect(editor.plan.items.map((item) => item.kind)).toEqual(['waypoint', 'waypoint', 'waypoint']);
    expect([...editor.selected]).toEqual(['item:2']);
    editor.undo();
    expect(editor.plan.items).toHaveLength(2);
    editor.redo();
    expect(north_m(editor, 'item:2')).toBe(30);
  });

  it('keeps a return as the last item', () => {
    const editor = editorWithWaypoints();
    editor.addItem('return_home', null);
    editor.select([]);
    editor.addItem('waypoint', at(40));
    editor.select(['item:4']);
    editor.addItem('delay', null);
    expect(editor.plan.items.map((item) => item.kind)).toEqual(['waypoint', 'waypoint', 'waypoint', 'waypoint', 'delay', 'return_home']);
  });

  it('drags the whole selection, and undoes the drag as one change', () => {
    const editor = editorWithWaypoints();
    editor.stopPlacing();
    editor.pick('item:0', false);
    editor.pick('item:2', true);
    expect(editor.grab('item:0')).toBe('item:0');
    for (const to of [12, 15, 60]) editor.drag('item:0', at(to));
    editor.drop(true);
    expect([0, 1, 2].map((row) => north_m(editor, `item:${row}`))).toEqual([60, 20, 80]);
    editor.undo();
    expect([0, 1, 2].map((row) => north_m(editor, `item:${row}`))).toEqual([10, 20, 30]);
  });

  it('raises the whole selection in steps of 0.1 m, and undoes all steps together', () => {
    const editor = editorWithWaypoints();
    editor.stopPlacing();
    editor.change(edit.setItem(editor.plan, 2, { altitude: { value_m: 12.34, reference: 'amsl' } }));
    const altitudes = () => editor.plan.items.map((item) => item.altitude?.value_m);
    editor.select(['item:0', 'item:2']);
    editor.grab('item:0');
    for (const by_m of [1, NaN, Infinity, 4.26]) editor.raise(by_m);
    editor.drop(true);
    expect(altitudes()).toEqual([34.3, 30, 16.64]);
    editor.undo();
    expect(altitudes()).toEqual([30, 30, 12.34]);
    editor.raise(5); // nothing is grabbed
    expect(altitudes()).toEqual([30, 30, 12.34]);
  });

  it('moves everything back when a drag is cancelled', () => {
    const editor = editorWithWaypoints();
    const before = editor.plan;
    editor.grab('item:1');
    editor.drag('item:1', at(90));
    editor.drop(false);
    expect(editor.plan).toBe(before);
    expect([...editor.selected]).toEqual(['item:2']);
    expect(editor.canRedo).toBe(false);
  });

  it('inserts a point on a leg: at the dragged position, or in the middle', () => {
    const editor = editorWithWaypoints();
    expect(editor.grab('middle:1')).toBe('item:1');
    editor.drag('item:1', at(17));
    editor.drop(true);
    expect(editor.plan.items.map((_, row) => north_m(editor, `item:${row}`))).toEqual([10, 17, 20, 30]);
    editor.undo();
    expect(editor.plan.items).toHaveLength(3);
  });

  it('are not replaced by a file of areas alone', async () => {
    const areas = [{ name: 'field', outer: [], holes: [], uses: [], likely_use: null }];
    const notes = ['The KML file has 1 area: choose a use for each.', 'Left out: 2 styles.'];
    const { api } = fakeServer([200, { plan: EMPTY_PLAN, notes, areas }]);
    const editor = editorWithWaypoints();
    const plans = new Plans(api, editor, memoryStorage());
    expect(await plans.import(new File(['x'], 'field.kml'))).toBe(true);
    expect(editor.plan.items).toHaveLength(3);
    expect(plans.notice?.areas).toEqual(areas);
    plans.useArea(plans.notice?.areas?.[0] as never, { fence: [] } as never);
    expect(plans.notice).toEqual({ tone: 'caution', text: 'Left out: 2 styles.' });
    editor.pick('middle:2', false);
    expect(north_m(editor, 'item:2')).toBe(25);
  });

  it('selects a range in the list and deletes it', () => {
    const editor = editorWithWaypoints();
    editor.select(['item:0']);
    editor.selectRangeTo(1);
    expect(editor.remove()).toBe(true);
    expect(editor.plan.items).toHaveLength(1);
    editor.select([]);
    expect(editor.remove()).toBe(false);
  });

  it('draws an area by its corners; Delete removes the last corner', () => {
    const editor = editorWithWaypoints();
    editor.startPlacing({ type: 'area', use: 'inclusion' });
    for (const corner of [at(0, 0), at(50, 0), at(50, 50), at(0, 99)]) editor.press(corner);
    editor.remove();
    expect(editor.sketchCorners).toHaveLength(3);
    editor.addZone(true, editor.sketchCorners);
    expect(editor.plan.fence).toMatchObject([{ shape: 'polygon', inclusion: true, polygon: { length: 3 } }]);
    expect(editor.partToPlace).toBeNull();
  });

  it('deselects points that an undo removed', () => {
    const editor = editorWithWaypoints();
    editor.undo();
    expect([...editor.selected]).toEqual([]);
  });
});

/** A fake server: gives these responses in order and records the requests. */
function fakeServer(...responses: readonly [number, unknown][]) {
  const requests: { call: string; body: unknown }[] = [];
  let responseCount = 0;
  const api = new ApiClient('p', undefined, (path, init) => {
    requests.push({ call: `${init.method} ${path.replace('/api/v1', '')}`, body: typeof init.body === 'string' ? JSON.parse(init.body) : init.body });
    const [status, body] = responses[responseCount++] ?? [500, {}];
    return Promise.resolve(new Response(status === 204 ? null : JSON.stringify(body), { status }));
  });
  return { requests, api: new PlanApi(api) };
}

function memoryStorage(): Pick<Storage, 'getItem' | 'setItem' | 'removeItem'> {
  const stored = new Map<string, string>();
  return { getItem: (key) => stored.get(key) ?? null, setItem: (key, value) => void stored.set(key, value), removeItem: (key) => void stored.delete(key) };
}

const version = (number: number) => ({ id: 'abc', name: 'Tower', version: number, changed_unix_s: 0, changed_by: 'anna', item_count: 3 });

describe('plans on the server', () => {
  it('are created at the first save, and are later saved with the version that they are based on', async () => {
    const editor = editorWithWaypoints();
    const { api, requests } = fakeServer([201, version(1)], [200, version(2)]);
    const plans = new Plans(api, editor, memoryStorage());
    editor.rename('Tower');
    expect(plans.saved).toBe(false);
    await plans.save();
    expect(plans.saved).toBe(true);
    editor.press(at(40));
    expect(plans.saved).toBe(false);
    await plans.save();
    expect(requests.map(({ call }) => call)).toEqual(['POST /plans', 'PUT /plans/abc']);
    expect(requests[1]?.body).toMatchObject({ name: 'Tower', base_version: 1, plan: { items: { length: 4 } } });
    editor.undo();
    expect(plans.saved).toBe(false);
    editor.redo();
    expect(plans.saved).toBe(true);
  });

  it('saved by another client are not overwritten; the local plan can be saved as a new plan', async () => {
    const editor = editorWithWaypoints();
    const conflict = { code: 'conflict', detail: 'Plan Tower is at version 2, saved by bob.', remedy: 'Open version 2.' };
    const { api, requests } = fakeServer([201, version(1)], [409, conflict], [201, { ...version(1), id: 'new' }]);
    const plans = new Plans(api, editor, memoryStorage());
    await plans.save();
    editor.press(at(40));
    await plans.save();
    expect(plans.notice).toMatchObject({ tone: 'danger', conflict: true, text: 'Plan Tower is at version 2, saved by bob. Open version 2.' });
    expect(plans.saved).toBe(false);
    await plans.save(true);
    expect(requests.map(({ call }) => call)).toEqual(['POST /plans', 'PUT /plans/abc', 'POST /plans']);
    expect(plans.savedPlan?.id).toBe('new');
  });

  it('have older versions that can be opened and saved as the newest version', async () => {
    const editor = editorWithWaypoints();
    const { api, requests } = fakeServer([200, { versions: [version(3), version(2)] }], [200, { ...version(2), plan: EMPTY_PLAN }], [200, version(4)]);
    const plans = new Plans(api, editor, memoryStorage());
    const [newest, older] = (await plans.versions('abc')) ?? [];
    expect(await plans.openVersion(older as PlanVersion, newest as PlanVersion)).toBe(true);
    expect([editor.plan.items.length, plans.saved, plans.savedPlan?.version, plans.notice?.olderVersion]).toEqual([0, false, 3, true]);
    expect(plans.notice?.text).toContain('Version 2 of 3, saved by anna.');
    await plans.save();
    expect(requests.map(({ call }) => call)).toEqual(['GET /plans/abc/versions', 'GET /plans/abc?version=2', 'PUT /plans/abc']);
    expect(requests[2]?.body).toMatchObject({ base_version: 3 });
    editor.undo();
    expect(editor.plan.items).toHaveLength(3);
  });

  it('have a notice that names the client who saved or deleted the open plan', async () => {
    const editor = editorWithWaypoints();
    const { api } = fakeServer([201, version(1)]);
    const plans = new Plans(api, editor, memoryStorage());
    await plans.save();
    const event = { kind: 'plan_changed', vehicle: null, unix_s: 0, severity: null, text: '', action: 'saved', client: 'bob', plan: version(2) };
    plans.handleEvent({ ...event, client_key: 'me' }, 'me');
    expect(plans.notice?.text).toBe('Saved as version 1.');
    plans.handleEvent({ ...event, client_key: 'other' }, 'me');
    expect(plans.notice).toMatchObject({ conflict: true, text: 'bob saved version 2 of this plan. Your version is based on version 1.' });
    plans.handleEvent({ ...event, client_key: 'other', action: 'deleted' }, 'me');
    expect(plans.savedPlan).toBeNull();
  });

  it('are restored after a reload of the page, saved or not', async () => {
    const storage = memoryStorage();
    const editor = editorWithWaypoints();
    const { api } = fakeServer([201, version(1)]);
    const plans = new Plans(api, editor, storage);
    await plans.save();
    plans.store(editor.draft);
    const reloadedEditor = new PlanEditor();
    const reloadedPlans = new Plans(fakeServer().api, reloadedEditor, storage);
    expect(reloadedEditor.plan).toEqual(editor.plan);
    expect([reloadedPlans.saved, reloadedPlans.savedPlan?.version, reloadedEditor.canUndo]).toEqual([true, 1, false]);
    editor.press(at(40));
    plans.store(editor.draft);
    const unsavedPlans = new Plans(fakeServer().api, new PlanEditor(), storage);
    expect([unsavedPlans.saved, unsavedPlans.savedPlan?.id]).toEqual([false, 'abc']);
  });

  it('are restored although the stored conditions cannot be read, and the other way round', () => {
    const storage = memoryStorage();
    const editor = editorWithWaypoints();
    const plans = new Plans(fakeServer().api, editor, storage);
    plans.store(editor.draft);
    storage.setItem('gcs.plan-conditions', '{');
    const reloadedEditor = new PlanEditor();
    expect(new Plans(fakeServer().api, reloadedEditor, storage).conditions).toEqual(DEFAULT_CONDITIONS);
    expect(reloadedEditor.plan).toEqual(editor.plan);
    plans.setConditions({ ...DEFAULT_CONDITIONS, battery_wh: 100 });
    storage.setItem('gcs.plan-draft', '{}');
    expect(new Plans(fakeServer().api, new PlanEditor(), storage).conditions.battery_wh).toBe(100);
    expect([storage.getItem('gcs.plan-draft'), storage.getItem('gcs.plan-conditions')]).toEqual([null, expect.stringContaining('100')]);
  });

  it('ask for what an imported file does not state: altitudes, or their reference', async () => {
    const refusal = {
      code: 'invalid_request',
      detail: 'point 1: it has no altitude.',
      remedy: 'Give an altitude with its reference for the import.',
      field: 'altitude_m',
    };
    const { api, requests } = fakeServer(
      [422, refusal],
      [422, { ...refusal, field: 'altitude_reference' }],
      [200, { plan: { ...EMPTY_PLAN, planned_home: HOME }, notes: [], areas: [{ name: 'field', outer: [], holes: [], uses: [], likely_use: null }] }],
    );
    const editor = editorWithWaypoints();
    const plans = new Plans(api, editor, memoryStorage());
    const file = new File(['x'], 'field.kml');
    expect(await plans.import(file)).toBe(false);
    expect(plans.notice?.question).toEqual({ file, missing: 'altitude_m' });
    expect(await plans.import(file, { altitude_m: 30 })).toBe(false);
    expect(plans.notice?.question?.missing).toBe('altitude_reference');
    expect(await plans.import(file, { altitude_m: 30, altitude_reference: 'amsl' })).toBe(true);
    expect(requests[2]?.call).toBe('POST /plans/import?filename=field.kml&altitude_m=30&altitude_reference=amsl');
    expect(editor.draft.name).toBe('field');
    expect(plans.notice?.areas).toHaveLength(1);
    editor.undo();
    expect(editor.plan.items).toHaveLength(3);
  });

  it('ask for the use of each area in a file, and add exactly the zones of the chosen use, once', async () => {
    const ring = [0, 1, 2].map((i) => ({ lat_deg: 47 + i, lon_deg: 8 }));
    const zone = (inclusion: boolean) => ({ shape: 'polygon' as const, inclusion, polygon: ring });
    const uses = [
      { use: 'stay_inside' as const, text: 'Stay inside.', fence: [zone(true), zone(false)] },
      { use: 'stay_outside' as const, text: 'Stay out.', fence: [zone(false)] },
    ];
    const areas = ['no fly', 'field'].map((name) => ({ name, outer: ring, holes: [ring], likely_use: null, uses }));
    const { api } = fakeServer([200, { plan: EMPTY_PLAN, notes: [], areas }]);
    const editor = editorWithWaypoints();
    const plans = new Plans(api, editor, memoryStorage());
    await plans.import(new File(['x'], 'field.kml'));
    expect(editor.plan.fence).toEqual([]);
    const [noFly, field] = plans.notice?.areas ?? [];
    for (let click = 0; click < 2; click++) if (noFly !== undefined) plans.useArea(noFly, uses[1] as never);
    expect(editor.plan.fence).toEqual([zone(false)]);
    expect(plans.notice?.areas).toEqual([field]);
    if (field !== undefined) plans.useArea(field, uses[0] as never);
    expect(plans.notice, 'nothing is left to choose').toBeNull();
    expect(editor.plan.fence).toEqual([zone(false), zone(true), zone(false)]);
    editor.undo();
    expect(editor.plan.fence).toEqual([zone(false)]);
  });

  it('are checked again after another vehicle was selected and its battery was entered', async () => {
    const check = { findings: [], estimates: {}, not_known: [] };
    const { api, requests } = fakeServer([200, check], [200, check]);
    const storage = memoryStorage();
    const plans = new Plans(api, editorWithWaypoints(), storage);
    await plans.runCheck();
    plans.vehicle = '7';
    plans.setConditions({ ...DEFAULT_CONDITIONS, hover_power_w: 200, battery_wh: 100, mass_kg: 2 });
    expect(plans.isChecked).toBe(false);
    await plans.runCheck();
    expect(plans.isChecked).toBe(true);
    expect(requests[1]?.body).toMatchObject({ vehicle: '7', power: { hover_power_w: 200, battery_wh: 100, mass_kg: 2, reserve: 0.2 } });
    expect(new Plans(api, new PlanEditor(), storage).conditions.battery_wh).toBe(100);
  });

  it('are checked again after the page has read the missing parameters', async () => {
    const incompleteCheck = { findings: [{ code: 'parameters_unknown' }], estimates: {}, not_known: [] };
    const { api, requests } = fakeServer([200, incompleteCheck], [503, { detail: 'Busy.' }], [200, {}], [200, { ...incompleteCheck, findings: [] }]);
    const plans = new Plans(api, editorWithWaypoints(), memoryStorage());
    plans.vehicle = '7';
    await plans.runCheck();
    await plans.readParameters('7');
    expect([plans.notice?.text, plans.check?.findings.length]).toEqual(['The parameters were not read. Busy.', 1]);
    await plans.readParameters('7');
    expect(plans.check?.findings).toEqual([]);
    expect(requests[2]?.body).toEqual({ wait: true });
  });

  it('need a new check after each change, and show why a check failed', async () => {
    const editor = editorWithWaypoints();
    const { api } = fakeServer([200, { findings: [], estimates: {}, not_known: [] }], [503, { detail: 'Busy.' }]);
    const plans = new Plans(api, editor, memoryStorage());
    await plans.runCheck();
    expect([plans.isChecked, plans.check?.findings]).toEqual([true, []]);
    editor.begin(HOME);
    expect([plans.isChecked, plans.check]).toEqual([false, null]);
    editor.undo();
    editor.press(at(40));
    expect(plans.isChecked).toBe(false);
    await plans.runCheck();
    expect(plans.checkProblem).toBe('Not checked. Busy.');
  });
});
