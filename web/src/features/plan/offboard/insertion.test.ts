import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../../api/client';
import { PlanApi } from '../api';
import { PlanEditor } from '../editor/editor.svelte';
import { MissionInsertion } from './insertion.svelte';
import { withValue, type Mission, type JsonPath } from './mission';
import { newMission, newStep } from './step-titles';

const HOME = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 480 };
const TOWER = { id: 'abc', name: 'Tower' };
const BRANCH = { ...newStep('branch'), then: [newStep('hold')] };
const MISSION: Mission = { ...newMission(HOME), steps: [newStep('take_off'), newStep('hold'), BRANCH, newStep('land')] };
const DIFFERENT_STARTS = {
  code: 'invalid_request',
  field: 'positions',
  detail: "field positions: 'Tower' has positions relative to its start, and the planned starts are 120 m apart.",
  remedy: 'Choose from_start or same_places.',
};

interface Request {
  readonly plan: Mission;
  readonly at: JsonPath;
  readonly [field: string]: unknown;
}

/** The editor with a fake server that inserts a call at the requested path, or refuses the request. */
class Session {
  readonly editor = new PlanEditor();
  readonly requests: Request[] = [];
  refusal: { code: string; field?: string; detail: string; remedy: string | null } | null = null;
  /** Called during a request. */
  duringRequest: () => void = () => undefined;
  private readonly api = new PlanApi(new ApiClient('p', undefined, (_, init) => Promise.resolve(this.respond(JSON.parse(init.body as string) as Request))));
  readonly insertion = new MissionInsertion(this.api, this.editor);

  constructor(...selected: string[]) {
    this.editor.replace('Field', MISSION);
    this.editor.select(selected);
    this.insertion.open();
  }

  private respond(request: Request): Response {
    this.requests.push(request);
    this.duringRequest();
    if (this.refusal !== null) return new Response(JSON.stringify(this.refusal), { status: 422 });
    const [list, index] = [request.at.slice(0, -1), Number(request.at.at(-1))];
    const steps = list.reduce<unknown>((value, key) => (value as Record<string | number, unknown>)[key], request.plan) as Mission['steps'];
    const withCall = withValue(request.plan, list, [...steps.slice(0, index), { step: 'call', mission: 'Tower' }, ...steps.slice(index)]);
    const plan = { ...withCall, missions: { Tower: [newStep('photo')] } };
    return new Response(JSON.stringify({ plan, called: 'Tower', notes: ['A note.'] }));
  }

  get kinds(): (string | undefined)[] | undefined {
    return this.editor.mission?.steps.map((step) => step.step);
  }
}

describe('inserting a stored mission', () => {
  it('adds and selects a call before the final landing, as one change', async () => {
    const session = new Session();
    expect((await session.insertion.insert(TOWER))?.notes).toEqual(['A note.']);
    expect(session.requests[0]).toMatchObject({ plan_id: 'abc', at: ['steps', 3], in_air: true, positions: null });
    expect(session.kinds).toEqual(['take_off', 'hold', 'branch', 'call', 'land']);
    expect([...session.editor.selected]).toEqual(['step:step 4']);
    expect(session.insertion.isOpen).toBe(false);
    session.editor.undo();
    expect(session.editor.document).toBe(MISSION);
  });

  it.each([
    ['step:step 2', ['steps', 2], 'step:step 3'],
    ['step:step 3 then 1', ['steps', 2, 'then', 1], 'step:step 3 then 2'],
  ])('adds the call after the selected %s', async (selected, at, id) => {
    const session = new Session(selected);
    session.insertion.skipsTakeoffAndLanding = false;
    await session.insertion.insert(TOWER);
    expect(session.requests[0]).toMatchObject({ at, in_air: false });
    expect([...session.editor.selected]).toEqual([id]);
  });

  it('requires a choice of how to insert relative positions if the planned starts differ', async () => {
    const session = new Session();
    session.refusal = DIFFERENT_STARTS;
    expect(await session.insertion.insert(TOWER)).toBeNull();
    expect(session.insertion.missionAwaitingChoice).toEqual(TOWER);
    expect(session.insertion.problem).toBe("'Tower' has positions relative to its start, and the planned starts are 120 m apart.");
    session.refusal = null;
    expect(await session.insertion.insert(TOWER, 'same_places')).not.toBeNull();
    expect(session.requests[1]).toMatchObject({ positions: 'same_places' });
  });

  it('does not change the mission when the server refuses, and shows the reason and the remedy', async () => {
    const session = new Session();
    session.refusal = { code: 'invalid_request', field: 'plan_id', detail: "mission 'Tower': it is for 2 vehicles.", remedy: 'One vehicle only.' };
    expect(await session.insertion.insert(TOWER)).toBeNull();
    expect(session.editor.document).toBe(MISSION);
    expect(session.insertion).toMatchObject({
      isOpen: true,
      busy: false,
      missionAwaitingChoice: null,
      problem: "Mission 'Tower': it is for 2 vehicles. One vehicle only.",
    });
  });

  it('has no effect when the mission was changed or the form was closed during the request', async () => {
    const changedSession = new Session();
    changedSession.duringRequest = () => changedSession.editor.rename('Other');
    expect(await changedSession.insertion.insert(TOWER)).toBeNull();
    expect(changedSession.insertion.problem).toMatch(/changed during the request/);
    const closedSession = new Session();
    closedSession.duringRequest = () => closedSession.insertion.close();
    expect(await closedSession.insertion.insert(TOWER)).toBeNull();
    expect([closedSession.editor.document, closedSession.insertion.busy]).toEqual([MISSION, false]);
  });
});
