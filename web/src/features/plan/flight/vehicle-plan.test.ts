import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../../api/client';
import { positionAt } from '../../../vehicle/geo';
import { AcceptedErrors } from './accepted-errors.svelte';
import { defaultAltitude, EMPTY_PLAN } from '../document/document';
import type { Finding } from '../document/fixes';
import { comparisonText, differenceText, reportedState, vehiclePlanText, type Comparison } from './vehicle-plan';
import { newItem } from '../document/items';
import { VehicleMission } from './vehicle-mission.svelte';
import { interruptedText, resumeBody, resumeTexts, resumeButtonText, mainButton, startBody, startTexts } from './mission-start';

describe('the plan on the vehicle', () => {
  const operation = (more: object) => ({ id: 'o1', kind: 'mission/upload', vehicle: '1', state: 'running', progress: 0.5, text: 'Item 5 of 10.', ...more });
  const missionView = (state: string, plan: object | null, transfer: string | null = null) => ({
    vehicle: '1',
    mission: null,
    transfer,
    holds: { state, plan, known_unix_s: 1 },
  });
  const tower = { id: 'abc', version: 2, name: 'Tower' };
  const event = (more: object) => ({ kind: 'operation', vehicle: '1', unix_s: 0, severity: null, text: '', operation: operation(more) });
  /** Waits until pending requests have been answered. */
  const settle = () => new Promise((resolve) => setTimeout(resolve));

  /** A page with a fake server, which gives these responses in order and records the requests. */
  function pageWith(...responses: readonly [number, unknown][]) {
    const requests: string[] = [];
    const bodies: unknown[] = [];
    let responseCount = 0;
    const api = new ApiClient('p', undefined, (path, init) => {
      requests.push(`${init.method} ${path.replace('/api/v1', '')}`);
      bodies.push(typeof init.body === 'string' ? JSON.parse(init.body) : null);
      const [status, body] = responses[responseCount++] ?? [500, {}];
      return Promise.resolve(new Response(JSON.stringify(body), { status }));
    });
    return { requests, bodies, mission: new VehicleMission(api) };
  }

  it('matches the edited plan only in exactly the same version', async () => {
    const { mission } = pageWith([200, missionView('plan', tower)]);
    mission.selectVehicle('1');
    await settle();
    expect([mission.hasVersion('abc', 2), mission.hasVersion('abc', 3), mission.hasVersion('other', 2)]).toEqual([true, false, false]);
    expect(vehiclePlanText('Quad 101', mission.missionView?.holds, { id: 'abc', version: 2 })).toBe('This plan is on Quad 101.');
    expect(vehiclePlanText('Quad 101', mission.missionView?.holds, { id: 'abc', version: 3 })).toBe('On Quad 101: version 2 of this plan.');
    expect(vehiclePlanText('Quad 101', mission.missionView?.holds, null)).toBe('On Quad 101: the plan “Tower”.');
  });

  it('does not match if the vehicle has another or an unknown plan', async () => {
    for (const state of ['another', 'not_known']) {
      const { mission } = pageWith([200, missionView(state, tower)]);
      mission.selectVehicle('1');
      await settle();
      expect(mission.hasVersion('abc', 2)).toBe(false);
    }
  });

  it('is uploaded with progress and requested again after the upload', async () => {
    const { mission, requests } = pageWith([200, missionView('not_known', null)], [202, operation({})], [200, missionView('plan', tower)]);
    mission.selectVehicle('1');
    await settle();
    await mission.upload('1', async () => ({ id: 'abc', version: 2 }));
    mission.handleEvent(event({ progress: 0.9 }));
    mission.handleEvent(event({ vehicle: '2', progress: 0.1 }));
    expect([mission.running, mission.transfer?.progress]).toEqual([true, 0.9]);
    mission.handleEvent(event({ state: 'succeeded', progress: 1 }));
    await settle();
    expect([mission.running, mission.hasVersion('abc', 2)]).toEqual([false, true]);
    expect(requests).toEqual(['GET /vehicles/1/mission', 'POST /vehicles/1/mission/upload', 'GET /vehicles/1/mission']);
  });

  it('has a running upload that the page finds after a reload', async () => {
    const { mission } = pageWith(
      [200, missionView('not_known', null, 'an upload')],
      [200, { operations: [operation({ kind: 'mission/download' }), operation({})] }],
    );
    mission.selectVehicle('1');
    await settle();
    expect(mission.transfer?.id).toBe('o1');
  });

  it('shows why the upload failed', async () => {
    const { mission } = pageWith([200, missionView('not_known', null)], [409, { code: 'not_in_control', detail: 'anna has control.' }]);
    mission.selectVehicle('1');
    await settle();
    await mission.upload('1', async () => ({ id: 'abc', version: 2 }));
    expect(mission.problem?.detail).toBe('anna has control.');
    expect(mission.running).toBe(false);
  });

  it('that a vehicle in Mission would fly at once is uploaded after Hold, if a person says so', async () => {
    const refusal = { code: 'plan_findings', codes: ['flies_new_plan_at_once'], detail: 'Vehicle 1 is flying its mission.' };
    const { mission, bodies } = pageWith([200, missionView('another', null)], [409, refusal], [202, operation({})]);
    mission.selectVehicle('1');
    await settle();
    await mission.upload('1', async () => ({ id: 'abc', version: 2 }));
    expect(mission.wouldFlyNewPlan).toBe(true);
    await mission.upload('1', async () => ({ id: 'abc', version: 2 }), true);
    expect([mission.wouldFlyNewPlan, mission.problem, mission.running]).toEqual([false, null, true]);
    expect(bodies.slice(1)).toEqual([
      { plan_id: 'abc', version: 2 },
      { plan_id: 'abc', version: 2, hold_first: true },
    ]);
  });

  it('is requested again when the vehicle disarms or reaches an item, but not while it reports the same state', async () => {
    const interrupted = { ...missionView('plan', tower), no_resume: null, resume: { item: 3 } };
    const { mission, requests } = pageWith([200, { ...missionView('plan', tower), no_resume: 'Vehicle 1 is armed.' }], [200, interrupted], [200, interrupted]);
    const stateOf = (armed: boolean, current: number) => reportedState({ armed, mode: 'mission' } as never, { current, mission_id: 7 } as never, null);
    mission.selectVehicle('1');
    for (const state of [stateOf(true, 3), stateOf(true, 3)]) mission.onReportedState(state);
    await settle();
    expect([mission.missionView?.no_resume, requests.length]).toEqual(['Vehicle 1 is armed.', 1]);
    mission.onReportedState(stateOf(false, 3));
    await settle();
    expect([mission.missionView?.no_resume, mission.missionView?.resume?.item, requests.length]).toEqual([null, 3, 2]);
    mission.onReportedState(stateOf(false, 4));
    mission.onReportedState(stateOf(false, 4));
    await settle();
    expect(requests.length).toBe(3);
  });

  it('has a reported state that changes with armed state, mode, item, mission and flight', () => {
    const status = { armed: true, mode: 'mission', battery: 1 } as never;
    const [mission, flight] = [{ current: 1, mission_id: 7 } as never, { state: 'flying', started_unix_s: 1, item: 1 } as never];
    const states = [
      reportedState(status, mission, flight),
      reportedState({ armed: false, mode: 'mission' } as never, mission, flight),
      reportedState({ armed: true, mode: 'hold' } as never, mission, flight),
      reportedState(status, { current: 2, mission_id: 7 } as never, flight),
      reportedState(status, { current: 1, mission_id: 8 } as never, flight),
      reportedState(status, mission, { state: 'done', started_unix_s: 1 } as never),
      reportedState(null, null, null),
    ];
    expect(new Set(states).size).toBe(states.length);
    expect(reportedState(status, mission, { state: 'flying', started_unix_s: 1, remaining_s: 5 } as never)).toBe(states[0]);
  });

  it('is shown as in the response to the newest request, also if an earlier request gets its response later', async () => {
    const responses: ((response: object) => void)[] = [];
    const api = new ApiClient('p', undefined, () => new Promise((resolve) => responses.push((body) => resolve(Response.json(body)))));
    const mission = new VehicleMission(api);
    mission.selectVehicle('1');
    mission.onReportedState('armed');
    mission.onReportedState('disarmed');
    await settle();
    responses[1]?.({ ...missionView('plan', tower), no_resume: null });
    responses[0]?.({ ...missionView('plan', tower), no_resume: 'Vehicle 1 is armed.' });
    await settle();
    expect(mission.missionView?.no_resume).toBeNull();
  });

  it('is read back and compared', async () => {
    const difference = { part: 'mission', seq: 1, field: 'z', planned: 35, held: 20, essential: true };
    const comparison = { vehicle: '1', equal: false, differences: [difference], read_unix_s: 1, still_held: true };
    const download = operation({ kind: 'mission/download' });
    const { mission, requests } = pageWith([200, missionView('another', null)], [202, download], [200, comparison], [200, missionView('another', null)]);
    mission.selectVehicle('1');
    await settle();
    await mission.readBack('1', EMPTY_PLAN, { plan_id: 'abc', version: 2 });
    expect([mission.running, mission.comparison(EMPTY_PLAN)]).toEqual([true, null]);
    mission.handleEvent(event({ kind: 'mission/download', state: 'succeeded' }));
    await settle();
    expect(mission.comparison(EMPTY_PLAN)).toEqual(comparison);
    expect(mission.comparison({ ...EMPTY_PLAN })).toBeNull();
    expect(requests.slice(1, 3)).toEqual(['POST /vehicles/1/mission/download', 'POST /vehicles/1/mission/compare']);
  });

  it('has texts for the comparison and for each difference', () => {
    const comparison = (more: object): Comparison => ({ vehicle: '1', equal: true, differences: [], read_unix_s: 1, still_held: true, ...more });
    const difference = { part: 'mission', seq: 1, field: 'z', planned: 35, held: 20, essential: true } as const;
    expect(differenceText(difference)).toBe('Item 2 of the mission, altitude: 35.0 m in the plan, 20.0 m on the vehicle.');
    expect(differenceText({ ...difference, field: 'x', planned: 473977420, held: 473977421 })).toContain('latitude: 47.3977420° in the plan');
    expect(differenceText({ ...difference, field: 'y', planned: 1, held: 0 })).toContain('parameter 6: 1 in the plan, 0 on');
    expect(differenceText({ ...difference, field: 'frame', planned: 3, held: 0 })).toContain('altitude reference: above home in the plan, AMSL on the vehicle');
    expect(differenceText({ ...difference, field: 'frame', planned: 3, held: 7 })).toContain('MAV_FRAME 7 on the vehicle');
    expect(differenceText({ ...difference, field: 'param2', planned: null, held: 0 })).toContain('parameter 2: not set in the plan');
    expect(differenceText({ ...difference, part: 'fence', seq: null, field: 'count' })).toBe('The geofence: 35 items in the plan, 20 on the vehicle.');
    expect(comparisonText('Quad 1', comparison({}))).toContain('is identical to this plan');
    expect(comparisonText('Quad 1', comparison({ differences: [difference] }))).toContain('does not store this value');
    expect(comparisonText('Quad 1', comparison({ equal: false }))).toContain('differs from this plan');
    expect(comparisonText('Quad 1', comparison({ still_held: false }))).toContain('Read it back again');
  });
});

describe('the start of the plan on the vehicle', () => {
  const finding = (more: object): Finding => ({
    code: 'fence_crossed',
    severity: 'error',
    text: 'It leaves the fence.',
    place: { row: 1, zone: null, rally_point: null, obstacle: null, step: null },
    fix: null,
    limit: null,
    ...more,
  });

  it('needs a person’s acceptance of each error, for exactly this plan and vehicle', () => {
    const accepted = new AcceptedErrors();
    const [error, otherError] = [finding({}), finding({ text: 'It leaves it again.' })];
    accepted.set(error, EMPTY_PLAN, '1', true);
    expect(accepted.split([error, otherError, finding({ severity: 'warning' })], EMPTY_PLAN, '1')).toEqual({ blocking: [otherError], accepted: [error] });
    for (const [plan, id] of [[{ ...EMPTY_PLAN }, '1'] as const, [EMPTY_PLAN, '2'] as const])
      expect(accepted.split([error], plan, id).blocking).toEqual([error]);
    accepted.set(error, EMPTY_PLAN, '1', false);
    expect(accepted.has(error, EMPTY_PLAN, '1')).toBe(false);
  });

  it('asks for a confirmation that lists the accepted errors and is shown as dangerous', () => {
    const texts = startTexts('Quad 1', false, null, ['It leaves the fence.']);
    expect(texts.effect).toBe(
      'Arms, takes off and flies the mission stored on the vehicle from the first item. You accepted 1 error: It leaves the fence. Hold interrupts the mission; you can resume it.',
    );
    expect([texts.danger, startTexts('Quad 1', true, 3, []).danger]).toEqual([true, false]);
    expect(startTexts('Quad 1', true, 3, [])).toMatchObject({
      title: 'Fly the mission of Quad 1 from item 4',
      effect: expect.stringContaining('flies to item 4'),
    });
    expect(startTexts('Quad 1', true, null, [])).toMatchObject({ title: 'Resume the mission of Quad 1', verb: 'Resume' });
    expect(startTexts('Quad 1', true, null, [], null, { current: 2, count: 10 }).effect).toContain('The vehicle flies to item 3 of 10 (current)');
  });

  it('is offered by the main button, but not while the vehicle flies a mission', () => {
    const bar = { flies: false, inAir: false, isOnVehicle: true, hasItems: true, isSaved: true, resumes: false, progress: { current: 0, count: 10 } };
    expect(mainButton(bar)).toEqual({ does: 'fly', text: 'Fly…' });
    expect(mainButton({ ...bar, resumes: true })?.text).toBe('Fly from the beginning…');
    expect(mainButton({ ...bar, inAir: true, progress: { current: 2, count: 10 } })?.text).toBe('Resume at item 3 of 10…');
    expect(mainButton({ ...bar, isOnVehicle: false })).toEqual({ does: 'upload', text: 'Upload' });
    expect(mainButton({ ...bar, isOnVehicle: false, isSaved: false })?.text).toBe('Save and upload');
    expect(mainButton({ ...bar, isOnVehicle: false, hasItems: false })).toBeNull();
    for (const isOnVehicle of [true, false]) expect(mainButton({ ...bar, isOnVehicle, inAir: true, flies: true })).toBeNull();
  });

  it('starts at the item of the chosen row, counted with all items of earlier patterns', () => {
    const items = [10, 20, 30].map((north_m) => newItem('waypoint', positionAt({ lat_deg: 47.4, lon_deg: 8.5 }, { north_m, east_m: 0 }), defaultAltitude()));
    const plan = { ...EMPTY_PLAN, items: [{ kind: 'complex', items: items.slice(0, 2) } as const, ...items] };
    expect(startBody(plan, false, 2, [], 77)).toEqual({ item: 3, despite: [], mission_id: 77 });
    expect(startBody(plan, false, null, ['fence_crossed'], 0)).toEqual({ item: 0, despite: ['fence_crossed'] });
    expect(startBody(plan, true, null, [], 0)).toEqual({ despite: [] });
  });
});

describe('an interrupted flight', () => {
  const offer = {
    item: 6,
    title: 'Waypoint',
    count: 20,
    mission_id: 77,
    altitude_m: 40,
    altitude_reference: 'home',
    distance_m: 212.4,
    interrupted_item: 8,
    interrupted_unix_s: 1,
    cautions: ['PX4 does not repeat item 2.'],
  } as const;

  it('has texts about the item at which it resumes and how far it was flown', () => {
    expect(resumeButtonText(offer)).toBe('Resume at item 7 of 20…');
    expect(interruptedText(offer, '12 min ago')).toBe('Interrupted on the way to item 9 of 20, 12 min ago.');
  });

  it('asks for a confirmation that states the altitude, the distance to the item and all cautions', () => {
    expect(resumeTexts('Quad 1', offer, [])).toEqual({
      title: 'Resume the mission of Quad 1 at item 7 of 20',
      effect:
        'Arms, climbs at its current position to 40.0 m above home and flies 212 m straight to item 7 (waypoint). It flies the rest of the mission from there. PX4 does not repeat item 2. Hold interrupts the mission; you can resume it.',
      verb: 'Resume',
      danger: false,
    });
    const noDistance = resumeTexts('Quad 1', { ...offer, distance_m: null, altitude_reference: 'amsl', cautions: [] }, ['It leaves the fence.']);
    expect(noDistance.effect).toBe(
      'Arms, climbs at its current position to 40.0 m AMSL and flies straight to item 7 (waypoint). It flies the rest of the mission from there. You accepted 1 error: It leaves the fence. Hold interrupts the mission; you can resume it.',
    );
    expect(noDistance.danger).toBe(true);
  });

  it('resumes with the item and the mission id of the offer', () => {
    expect(resumeBody(offer, ['flight_from_here'])).toEqual({ item: 6, mission_id: 77, despite: ['flight_from_here'] });
  });
});
