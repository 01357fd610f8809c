import { describe, expect, it } from 'vitest';
import { ApiClient, ofVehicle } from '../../../api/client';
import { positionAt } from '../../../vehicle/geo';
import { AcceptedErrors, StartErrors } from './accepted-errors.svelte';
import { DEFAULT_ALTITUDE, EMPTY } from '../document/document';
import type { Finding } from '../document/fixes';
import { comparisonText, differenceText, reportedState, vehiclePlanText, type Comparison } from './vehicle-plan';
import { newItem } from '../document/items';
import { VehicleMission } from './plan-transfer.svelte';
import { interruptedText, resumeBody, resumeQuestion, resumeVerb, startBody, startQuestion } from './mission-start';

describe('the plan on the vehicle', () => {
  const operation = (over: object) => ({ id: 'o1', kind: 'mission/upload', vehicle: '1', state: 'running', progress: 0.5, text: 'Item 5 of 10.', ...over });
  const view = (state: string, plan: object | null, transfer: string | null = null) => ({
    vehicle: '1',
    mission: null,
    transfer,
    holds: { state, plan, known_unix_s: 1 },
  });
  const named = { id: 'abc', version: 2, name: 'Tower' };
  const event = (over: object) => ({ kind: 'operation', vehicle: '1', unix_s: 0, severity: null, text: '', operation: operation(over) });
  /** Waits until pending requests have been answered. */
  const settled = () => new Promise((done) => setTimeout(done));

  function vehicle(...answers: readonly [number, unknown][]) {
    const asked: string[] = [];
    let turn = 0;
    const api = new ApiClient('p', undefined, (path, init) => {
      asked.push(`${init.method} ${path.replace('/api/v1', '')}`);
      const [status, body] = answers[turn++] ?? [500, {}];
      return Promise.resolve(new Response(JSON.stringify(body), { status }));
    });
    return { asked, mission: new VehicleMission(api) };
  }

  it('matches the open plan only in exactly the same version', async () => {
    const { mission } = vehicle([200, view('plan', named)]);
    mission.selectVehicle('1');
    await settled();
    expect([mission.hasVersion('abc', 2), mission.hasVersion('abc', 3), mission.hasVersion('other', 2)]).toEqual([true, false, false]);
    expect(vehiclePlanText('101 Quad', mission.view?.holds, { id: 'abc', version: 2 })).toBe('This plan is on 101 Quad.');
    expect(vehiclePlanText('101 Quad', mission.view?.holds, { id: 'abc', version: 3 })).toBe('On 101 Quad: version 2 of this plan.');
    expect(vehiclePlanText('101 Quad', mission.view?.holds, null)).toBe('On 101 Quad: the plan “Tower”.');
  });

  it('does not match if the vehicle reports another plan or none', async () => {
    for (const state of ['another', 'not_known']) {
      const { mission } = vehicle([200, view(state, named)]);
      mission.selectVehicle('1');
      await settled();
      expect(mission.hasVersion('abc', 2)).toBe(false);
    }
  });

  it('is uploaded with progress and requested again at the end', async () => {
    const { mission, asked } = vehicle([200, view('not_known', null)], [202, operation({})], [200, view('plan', named)]);
    mission.selectVehicle('1');
    await settled();
    await mission.send('abc', 2);
    mission.onEvent(event({ progress: 0.9 }));
    mission.onEvent(event({ vehicle: '2', progress: 0.1 }));
    expect([mission.running, mission.transfer?.progress]).toEqual([true, 0.9]);
    mission.onEvent(event({ state: 'succeeded', progress: 1 }));
    await settled();
    expect([mission.running, mission.hasVersion('abc', 2)]).toEqual([false, true]);
    expect(asked).toEqual(['GET /vehicles/1/mission', 'POST /vehicles/1/mission/upload', 'GET /vehicles/1/mission']);
  });

  it('is found again during its upload after a reload', async () => {
    const { mission } = vehicle([200, view('not_known', null, 'an upload')], [200, { operations: [operation({ kind: 'mission/download' }), operation({})] }]);
    mission.selectVehicle('1');
    await settled();
    expect(mission.transfer?.id).toBe('o1');
  });

  it('shows why the upload failed', async () => {
    const { mission } = vehicle([200, view('not_known', null)], [409, { code: 'not_in_control', detail: 'anna has control.' }]);
    mission.selectVehicle('1');
    await settled();
    await mission.send('abc', 2);
    expect(mission.problem?.detail).toBe('anna has control.');
    expect(mission.running).toBe(false);
  });

  it('is requested again when the vehicle is disarmed or reaches an item, and not while it reports the same', async () => {
    const interrupted = { ...view('plan', named), no_resume: null, resume: { item: 3 } };
    const { mission, asked } = vehicle([200, { ...view('plan', named), no_resume: 'Vehicle 1 is armed.' }], [200, interrupted], [200, interrupted]);
    const at = (armed: boolean, current: number) => reportedState({ armed, mode: 'mission' } as never, { current, mission_id: 7 } as never, null);
    mission.selectVehicle('1');
    for (const state of [at(true, 3), at(true, 3)]) mission.onReported(state);
    await settled();
    expect([mission.view?.no_resume, asked.length]).toEqual(['Vehicle 1 is armed.', 1]);
    mission.onReported(at(false, 3));
    await settled();
    expect([mission.view?.no_resume, mission.view?.resume?.item, asked.length]).toEqual([null, 3, 2]);
    mission.onReported(at(false, 4));
    mission.onReported(at(false, 4));
    await settled();
    expect(asked.length).toBe(3);
  });

  it('changes with armed state, mode, item, mission and state of the flight', () => {
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

  it('shows the answer to the newest request, also if an earlier one is answered later', async () => {
    const answers: ((view: object) => void)[] = [];
    const api = new ApiClient('p', undefined, () => new Promise((done) => answers.push((body) => done(Response.json(body)))));
    const mission = new VehicleMission(api);
    mission.selectVehicle('1');
    mission.onReported('armed');
    mission.onReported('disarmed');
    await settled();
    answers[1]?.({ ...view('plan', named), no_resume: null });
    answers[0]?.({ ...view('plan', named), no_resume: 'Vehicle 1 is armed.' });
    await settled();
    expect(mission.view?.no_resume).toBeNull();
  });

  it('is read back, compared and listed value by value', async () => {
    const difference = { part: 'mission', seq: 1, field: 'z', planned: 35, held: 20, essential: true };
    const found = { vehicle: '1', equal: false, differences: [difference], read_unix_s: 1, still_held: true };
    const download = operation({ kind: 'mission/download' });
    const { mission, asked } = vehicle([200, view('another', null)], [202, download], [200, found], [200, view('another', null)]);
    mission.selectVehicle('1');
    await settled();
    await mission.readBack(EMPTY, { plan_id: 'abc', version: 2 });
    expect([mission.running, mission.comparison(EMPTY)]).toEqual([true, null]);
    mission.onEvent(event({ kind: 'mission/download', state: 'succeeded' }));
    await settled();
    expect(mission.comparison(EMPTY)).toEqual(found);
    expect(mission.comparison({ ...EMPTY })).toBeNull();
    expect(asked.slice(1, 3)).toEqual(['POST /vehicles/1/mission/download', 'POST /vehicles/1/mission/compare']);
  });

  it('lists each difference with item, field and both values', () => {
    const found = (over: object): Comparison => ({ vehicle: '1', equal: true, differences: [], read_unix_s: 1, still_held: true, ...over });
    const one = { part: 'mission', seq: 1, field: 'z', planned: 35, held: 20, essential: true } as const;
    expect(differenceText(one)).toBe('Item 2 of the mission, altitude: 35.0 m in the plan, 20.0 m on the vehicle.');
    expect(differenceText({ ...one, field: 'x', planned: 473977420, held: 473977421 })).toContain('latitude: 47.3977420° in the plan');
    expect(differenceText({ ...one, field: 'y', planned: 1, held: 0 })).toContain('parameter 6: 1 in the plan, 0 on');
    expect(differenceText({ ...one, field: 'param2', planned: null, held: 0 })).toContain('parameter 2: not set in the plan');
    expect(differenceText({ ...one, part: 'fence', seq: null, field: 'count' })).toBe('The geofence: 35 items in the plan, 20 on the vehicle.');
    expect(comparisonText('1 Quad', found({}))).toContain('is identical to this plan');
    expect(comparisonText('1 Quad', found({ differences: [one] }))).toContain('does not store this value');
    expect(comparisonText('1 Quad', found({ equal: false }))).toContain('differs from this plan');
    expect(comparisonText('1 Quad', found({ still_held: false }))).toContain('Read it back again');
  });
});

describe('flying the plan on the vehicle', () => {
  const finding = (over: object): Finding => ({
    code: 'fence_crossed',
    severity: 'error',
    text: 'It leaves the fence.',
    place: { row: 1, zone: null, rally_point: null, obstacle: null, step: null },
    fix: null,
    limit: null,
    ...over,
  });

  it('needs a person’s acceptance of each error, for exactly this plan and vehicle', () => {
    const accepted = new AcceptedErrors();
    const [one, other] = [finding({}), finding({ text: 'It leaves it again.' })];
    accepted.set(one, EMPTY, '1', true);
    expect(accepted.split([one, other, finding({ severity: 'warning' })], EMPTY, '1')).toEqual({ open: [other], despite: [one] });
    for (const [plan, id] of [[{ ...EMPTY }, '1'] as const, [EMPTY, '2'] as const]) expect(accepted.split([one], plan, id).open).toEqual([one]);
    accepted.set(one, EMPTY, '1', false);
    expect(accepted.has(one, EMPTY, '1')).toBe(false);
  });

  it('needs acceptance of errors found at the start, for exactly this plan and vehicles', async () => {
    const refusal = { code: 'plan_findings', detail: 'Errors.', codes: ['separation'], reasons: ['lead, step 2: They come too near.'] };
    const api = new ApiClient('p', undefined, () => Promise.resolve(Response.json(refusal, { status: 409 })));
    const found = new StartErrors();
    const vehicles = { lead: '1', left: '2' };
    found.setOutcome(await api.post('/vehicles/{v}/hold', ofVehicle('1')), EMPTY, vehicles);
    expect([found.findings(EMPTY, { ...vehicles }), found.codes(EMPTY, vehicles)]).toEqual([refusal.reasons, []]);
    found.accepted = true;
    expect(found.codes(EMPTY, vehicles)).toEqual(['separation']);
    expect([found.codes({ ...EMPTY }, vehicles), found.codes(EMPTY, { lead: '2', left: '1' })]).toEqual([[], []]);
    found.setOutcome({ ok: true, value: null }, EMPTY, vehicles);
    expect(found.findings(EMPTY, vehicles)).toEqual([]);
  });

  it('lists the accepted errors, and confirms as a dangerous action', () => {
    const question = startQuestion('1 Quad', false, null, ['It leaves the fence.']);
    expect(question.effect).toBe(
      'Arms, takes off and flies the mission stored on the vehicle from the first step. You accepted 1 error: It leaves the fence. Hold pauses the mission.',
    );
    expect([question.danger, startQuestion('1 Quad', true, 3, []).danger]).toEqual([true, false]);
    expect(startQuestion('1 Quad', true, 3, [])).toMatchObject({
      title: 'Fly the mission of 1 Quad from step 4',
      effect: expect.stringContaining('flies to step 4'),
    });
    expect(startQuestion('1 Quad', true, null, [])).toMatchObject({ title: 'Resume the mission of 1 Quad', verb: 'Resume' });
  });

  it('starts at the item of a step, counted after all items of earlier patterns', () => {
    const items = [10, 20, 30].map((north_m) => newItem('waypoint', positionAt({ lat_deg: 47.4, lon_deg: 8.5 }, { north_m, east_m: 0 }), DEFAULT_ALTITUDE));
    const plan = { ...EMPTY, items: [{ kind: 'complex', items: items.slice(0, 2) } as const, ...items] };
    expect(startBody(plan, false, 2, [])).toEqual({ item: 3, despite: [] });
    expect(startBody(plan, false, null, ['fence_crossed'])).toEqual({ item: 0, despite: ['fence_crossed'] });
    expect(startBody(plan, true, null, [])).toEqual({ despite: [] });
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

  it('states where it resumes, and how far it was flown', () => {
    expect(resumeVerb(offer)).toBe('Resume at item 7 of 20…');
    expect(interruptedText(offer, '12 min ago')).toBe('Interrupted on the way to item 9 of 20, 12 min ago.');
  });

  it('asks for a confirmation that states the altitude and the distance to the item, and everything that is different', () => {
    expect(resumeQuestion('1 Quad', offer, [])).toEqual({
      title: 'Resume the mission of 1 Quad at item 7 of 20',
      effect:
        'Arms, climbs at its current position to 40.0 m above home and flies 212 m straight to item 7 (waypoint). It flies the rest of the mission from there. PX4 does not repeat item 2. Hold pauses the mission.',
      verb: 'Resume',
      danger: false,
    });
    const unknown = resumeQuestion('1 Quad', { ...offer, distance_m: null, altitude_reference: 'amsl', cautions: [] }, ['It leaves the fence.']);
    expect(unknown.effect).toBe(
      'Arms, climbs at its current position to 40.0 m AMSL and flies straight to item 7 (waypoint). It flies the rest of the mission from there. You accepted 1 error: It leaves the fence. Hold pauses the mission.',
    );
    expect(unknown.danger).toBe(true);
  });

  it('starts at that item of that mission only', () => {
    expect(resumeBody(offer, ['flight_from_here'])).toEqual({ item: 6, mission_id: 77, despite: ['flight_from_here'] });
  });
});
