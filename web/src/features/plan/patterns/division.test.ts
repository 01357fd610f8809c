import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../../api/client';
import { PlanApi } from '../api';
import { EMPTY_PLAN, type PatternItem, type Plan } from '../document/document';
import { PlanEditor } from '../editor/editor.svelte';
import { RoleAssignment } from '../flight/accepted-errors.svelte';
import type { CompiledFlight } from '../offboard/mission';
import { closestText, roleFigures } from '../offboard/roles';
import { newMission } from '../offboard/step-titles';
import { SurveyDivision } from './division.svelte';

const HOME = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const SURVEY = { kind: 'pattern', pattern: { kind: 'survey', outer: [] }, items: [], items_key: '' } as unknown as PatternItem;
const MISSION = { ...newMission(HOME), roles: { 'part 1': { steps: [] }, 'part 2': { steps: [] } } };

/** The editor with a survey, and a fake server. */
class Session {
  readonly editor = new PlanEditor();
  readonly assignment = new RoleAssignment();
  readonly requests: Record<string, unknown>[] = [];
  refusal: object | null = null;
  duringRequest: () => void = () => undefined;
  private readonly api = new PlanApi(
    new ApiClient('p', undefined, (_, init) => Promise.resolve(this.respond(JSON.parse(init.body as string) as Record<string, unknown>))),
  );
  readonly division = new SurveyDivision(this.api, this.editor, this.assignment);

  constructor() {
    this.editor.replace('Field', { ...EMPTY_PLAN, planned_home: HOME, items: [SURVEY] } as Plan);
    this.division.open(0);
  }

  private respond(request: Record<string, unknown>): Response {
    this.requests.push(request);
    this.duringRequest();
    if (this.refusal !== null) return new Response(JSON.stringify(this.refusal), { status: 422 });
    const vehicles = (request['vehicles'] as string[] | undefined) ?? [null, null];
    const parts = vehicles.map((vehicle, i) => ({ role: `part ${i + 1}`, vehicle, lines: [], layer_m: 0 }));
    return new Response(JSON.stringify({ plan: MISSION, parts, notes: [] }));
  }
}

describe('dividing a survey', () => {
  it('replaces the plan by a mission as one change, with the chosen vehicles in their roles', async () => {
    const { division, editor, assignment, requests } = new Session();
    division.choose('2', true);
    division.choose('5', true);
    division.choose('7', true);
    division.choose('7', false);
    division.minimumSeparation_m = 8;
    expect((await division.divide())?.parts.length).toBe(2);
    expect(requests[0]).toMatchObject({ item: 0, name: 'Field, divided', vehicles: ['2', '5'], minimum_separation_m: 8 });
    expect(requests[0]).not.toHaveProperty('count');
    expect(editor.draft.name).toBe('Field, divided');
    expect(assignment.forRoles(['part 1', 'part 2'])).toEqual({ 'part 1': '2', 'part 2': '5' });
    expect(division.survey).toBeNull();
    editor.undo();
    expect(editor.mission).toBeNull();
    expect(editor.plan.items).toEqual([SURVEY]);
  });

  it('asks for a number if no vehicle is chosen, and forgets earlier vehicles of these roles', async () => {
    const { division, assignment, requests } = new Session();
    assignment.choose('part 1', '9');
    division.count = 2;
    await division.divide();
    expect(requests[0]).toMatchObject({ count: 2 });
    expect(requests[0]).not.toHaveProperty('vehicles');
    expect(assignment.forRoles(['part 1'])).toEqual({ 'part 1': '' });
  });

  it('keeps the plan if the server refuses, the plan has changed, or the form was closed', async () => {
    const session = new Session();
    session.refusal = { code: 'invalid_request', field: 'vehicles', detail: 'vehicles: it is too small for 9 vehicles.', remedy: 'Choose fewer vehicles.' };
    expect(await session.division.divide()).toBeNull();
    expect(session.division.problem).toBe('It is too small for 9 vehicles. Choose fewer vehicles.');
    session.refusal = null;
    session.duringRequest = () => session.editor.change({ ...session.editor.plan, hover_speed_m_s: 7 });
    expect(await session.division.divide()).toBeNull();
    expect(session.division.problem).toMatch(/changed during the request/);
    session.duringRequest = () => session.division.close();
    expect(await session.division.divide()).toBeNull();
    expect(session.editor.mission).toBeNull();
  });

  it('closes when the survey is no longer there', () => {
    const { division, editor } = new Session();
    expect(division.survey).toEqual(SURVEY);
    editor.undo();
    expect(division.survey).toBeNull();
  });
});

describe('what is planned for several vehicles', () => {
  const flight = {
    roles: [{ role: 'part 1', time_s: 461, length_m: 1890, photos: 96 }],
    closest: [
      { roles: ['part 1', 'part 2'], distance_m: 15.8, t_s: 0 },
      { roles: ['part 1', 'part 3'], distance_m: 7.9, t_s: 480 },
    ],
  } as unknown as CompiledFlight;

  it('has time, length and photos of each role, and the smallest distance of all pairs', () => {
    expect(roleFigures(flight, 'part 1')).toBe('7 min 41 s · 1890 m · 96 photos');
    expect(roleFigures(flight, 'part 9')).toBe('');
    expect(closestText(flight)).toBe('Smallest planned distance: 7.9 m, part 1 and part 3 after 8 min 00 s.');
    expect(closestText({ ...flight, closest: [] })).toBeNull();
  });
});
