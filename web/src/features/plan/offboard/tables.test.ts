import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../../api/client';
import { PlanApi } from '../api';
import { PlanEditor } from '../editor/editor.svelte';
import { Plans } from '../plans.svelte';
import { nodesOf, type Mission, type StepNode } from './mission';
import { newMission, newStep } from './step-titles';
import { MAX_TABLES, withTable } from './edit';

const HOME = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const TABLE = { name: 'loop.csv', text: 't_s,north_m,east_m,down_m\n0,0,0,-9\n2,4,0,-9\n' };
const tableStep = (file: string) => ({ ...newStep('table'), file });
const missionOf = (files: readonly string[], tables: Record<string, string>): Mission => ({ ...newMission(HOME), steps: files.map(tableStep), tables });
const nodeOf = (mission: Mission, index = 0): StepNode => nodesOf(mission)[index] as StepNode;
const filesOf = (mission: Mission | null) => mission?.steps.map((step) => step['file']);

describe('a table of a mission', () => {
  it('replaces the table that only this step used', () => {
    const mission = missionOf(['old.csv'], { 'old.csv': 'x', 'spare.csv': 'y' });
    const changed = withTable(mission, nodeOf(mission), TABLE);
    expect(changed?.tables).toEqual({ 'spare.csv': 'y', 'loop.csv': TABLE.text });
    expect(filesOf(changed)).toEqual(['loop.csv']);
    expect(mission.tables).toEqual({ 'old.csv': 'x', 'spare.csv': 'y' });
  });

  it('keeps a table that another step uses, also one with the same name', () => {
    const mission = missionOf(['loop.csv', 'loop.csv'], { 'loop.csv': 'x', 'loop 2.csv': 'y' });
    const changed = withTable(mission, nodeOf(mission), TABLE);
    expect(changed?.tables).toEqual({ 'loop.csv': 'x', 'loop 2.csv': 'y', 'loop 3.csv': TABLE.text });
    expect(filesOf(changed)).toEqual(['loop 3.csv', 'loop.csv']);
  });

  it('keeps a table that a step in an uncalled list uses', () => {
    const mission = { ...missionOf(['old.csv'], { 'old.csv': 'x' }), missions: { spare: [{ ...newStep('repeat'), steps: [tableStep('old.csv')] }] } };
    expect(withTable(mission, nodeOf(mission), TABLE)?.tables).toEqual({ 'old.csv': 'x', 'loop.csv': TABLE.text });
  });

  it('is stored once for two steps with the same content', () => {
    const mission = missionOf(['path.csv', 'loop.csv'], { 'loop.csv': TABLE.text });
    const changed = withTable(mission, nodeOf(mission), TABLE);
    expect([changed?.tables, filesOf(changed)]).toEqual([{ 'loop.csv': TABLE.text }, ['loop.csv', 'loop.csv']]);
  });

  it('is refused if the mission would have too many tables', () => {
    const fullTables = Object.fromEntries(Array.from({ length: MAX_TABLES }, (_, number) => [`${number}.csv`, 'x']));
    const mission = missionOf(['0.csv', 'path.csv'], fullTables);
    expect(withTable(mission, nodeOf(mission, 1), TABLE)).toBeNull();
    expect(Object.keys(withTable(mission, nodeOf(mission), TABLE)?.tables ?? {})).toHaveLength(MAX_TABLES);
  });
});

describe('importing a trajectory', () => {
  const file = new File(['x'], 'loop.npy');
  function session(status: number, body: object, duringRequest: (editor: PlanEditor) => void = () => undefined) {
    const editor = new PlanEditor();
    const api = new PlanApi(
      new ApiClient('p', undefined, () => {
        duringRequest(editor);
        return Promise.resolve(new Response(JSON.stringify(body), { status }));
      }),
    );
    const memory = { getItem: () => null, setItem: () => undefined, removeItem: () => undefined };
    editor.replace('Loop', missionOf(['path.csv'], {}));
    return { editor, plans: new Plans(api, editor, memory), node: nodeOf(editor.mission as Mission) };
  }

  it('is one change, with a notice about the content of the file', async () => {
    const { editor, plans, node } = session(200, { ...TABLE, rows: 2, duration_s: 2, has_yaw: false });
    expect(await plans.importTable(file, node)).toBe(true);
    expect(editor.mission?.tables).toEqual({ 'loop.csv': TABLE.text });
    expect(plans.notice).toEqual({ tone: 'ok', text: '“loop.npy”: 2 rows, 2.0 s, without yaw.' });
    editor.undo();
    expect([editor.mission?.tables, filesOf(editor.mission)]).toEqual([{}, ['path.csv']]);
  });

  it('does not change the mission when the server refuses the file, and shows the reason and the remedy', async () => {
    const problem = { code: 'invalid_request', detail: 'body: the table: its shape is (20,).', remedy: 'Save shape (N, 4).', field: 'body' };
    const { editor, plans, node } = session(422, problem);
    const before = editor.document;
    expect(await plans.importTable(file, node)).toBe(false);
    expect(editor.document).toBe(before);
    expect(plans.notice).toMatchObject({ tone: 'danger', text: expect.stringMatching(/loop\.npy.*shape is \(20,\).*Save shape/s) as string });
  });

  it('has no effect when the mission was changed during the request', async () => {
    const { editor, plans, node } = session(200, { ...TABLE, rows: 2, duration_s: 2, has_yaw: false }, (editor) => editor.rename('Other'));
    expect(await plans.importTable(file, node)).toBe(false);
    expect(editor.mission?.tables).toEqual({});
    expect(plans.notice?.text).toMatch(/changed during the request/);
  });
});
