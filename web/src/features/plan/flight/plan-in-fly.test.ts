import { beforeEach, describe, expect, it, vi } from 'vitest';
import { FakeServer, stubBrowser } from '../../../app/page.fixture';
import { EMPTY_PLAN } from '../document/document';
import { newItem } from '../document/items';

stubBrowser();
const server = new FakeServer();
vi.stubGlobal('fetch', server.fetch);
const { page } = await import('../../../app/page.svelte');
const { CommandGate } = await import('../../../app/actions/command.svelte');
const { PlanInFly, planKey } = await import('./plan-in-fly.svelte');

const MISSION = { current: 1, count: 2, reached: 0, mission_id: 7, fence_id: 0, rally_points_id: 0 };
const at = { lat_deg: 47.4, lon_deg: 8.5 };
const PLAN = {
  ...EMPTY_PLAN,
  items: [newItem('takeoff', at, { value_m: 10, reference: 'home' }), newItem('waypoint', at, { value_m: 10, reference: 'home' })],
};

async function answer(path: string, body: unknown, status = 200): Promise<void> {
  await vi.waitFor(() => expect(server.open.map((request) => request.path)).toContain(path));
  server.open.find((request) => request.path === path)?.answer(new Response(JSON.stringify(body), { status, headers: { 'Content-Type': 'application/json' } }));
  await new Promise((resolve) => setTimeout(resolve));
}
const view = (known: boolean, transfer: string | null = null) => ({ holds: { state: 'not_known', plan: null, known_unix_s: known ? 1 : null }, transfer });
const paths = () => server.requests.map(({ method, path }) => `${method} ${path}`);

describe('the plan on the selected vehicle', () => {
  beforeEach(() => void (server.requests = []));

  it('is the one that the server knows, without anything sent to the vehicle', async () => {
    const shown = new PlanInFly(page.api, new CommandGate());
    shown.show('1', MISSION);
    await answer('/vehicles/1/mission', view(true));
    await answer('/vehicles/1/mission/plan', { plan: PLAN, still_held: true });
    expect(shown.plan?.items).toHaveLength(2);
    shown.poll();
    expect(paths()).toEqual(['GET /vehicles/1/mission', 'GET /vehicles/1/mission/plan']);
    shown.show('1', { ...MISSION, mission_id: 8 });
    expect(shown.plan).toBeNull();
  });

  it('is read from the vehicle once if another station has uploaded it, and drawn when the reading ends', async () => {
    const shown = new PlanInFly(page.api, new CommandGate());
    shown.show('1', MISSION);
    await answer('/vehicles/1/mission', view(false));
    expect(paths()).toEqual(['GET /vehicles/1/mission']); // the ids may still be changing
    shown.poll();
    await answer('/vehicles/1/mission', view(false));
    await answer('/vehicles/1/mission/download', { id: 'o1', state: 'running' }, 202);
    shown.poll();
    await answer('/vehicles/1/mission', view(false, 'a download'));
    shown.handleEvent({ kind: 'operation', operation: { id: 'o1', vehicle: '1', kind: 'mission/download', state: 'succeeded', text: '' } } as never);
    await answer('/vehicles/1/mission', view(true));
    await answer('/vehicles/1/mission/plan', { plan: PLAN, still_held: true });
    expect(shown.plan?.items).toHaveLength(2);
    expect(paths().filter((path) => path.startsWith('POST'))).toHaveLength(1);
  });

  it('is not the one that the server read before: the vehicle has another', async () => {
    const shown = new PlanInFly(page.api, new CommandGate());
    shown.show('1', { ...MISSION, count: 3 });
    await answer('/vehicles/1/mission', view(true));
    await answer('/vehicles/1/mission/plan', { plan: PLAN, still_held: null }); // a vehicle without ids, with another number of items
    expect(shown.plan).toBeNull();
  });

  it('says why it cannot be read, and reads again only when a person asks', async () => {
    const shown = new PlanInFly(page.api, new CommandGate());
    shown.show('1', MISSION);
    await answer('/vehicles/1/mission', view(false));
    shown.poll();
    await answer('/vehicles/1/mission', view(false));
    await answer('/vehicles/1/mission/download', { detail: 'Not allowed.', code: 'forbidden', title: 'x' }, 403);
    expect(shown.problem?.detail).toBe('Not allowed.');
    shown.poll();
    await answer('/vehicles/1/mission', view(false));
    expect(paths().filter((path) => path.startsWith('POST'))).toHaveLength(1);
    void shown.read('1');
    await answer('/vehicles/1/mission/download', { id: 'o2', state: 'running' }, 202);
    expect(shown.problem).toBeNull();
  });

  it('is none without a mission', () => {
    expect(planKey('1', null)).toBeNull();
    expect(planKey('1', { ...MISSION, count: 0 })).toBeNull();
  });
});
