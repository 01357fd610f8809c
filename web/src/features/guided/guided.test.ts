import { describe, expect, it, vi } from 'vitest';
import { ApiClient } from '../../api/client';
import { ActionController } from '../../app/actions/controller.svelte';
import type { VehicleFacts } from '../../vehicle/facts';
import { groundDistance_m } from '../../vehicle/geo';
import {
  confirmationTexts,
  effectText,
  fenceText,
  fieldProblem,
  flownCircle,
  futuresOf,
  NO_LIMITS,
  orbitSpeedMax_m_s,
  previewContent,
  progressOf,
  whyNot,
  type Draft,
  type Limits,
} from './guided';
import { GuidedCommands } from './guided.svelte';

const LIMITS: Limits = { ...NO_LIMITS, speedMax_m_s: 12, cruise_m_s: 5, up_m_s: 3, down_m_s: 1.5, turn_deg_s: 45, radiusMax_m: 1000, returnAlt_m: 30 };
const HERE = { lat_deg: 47.4, lon_deg: 8.5 };
const NORTH = { lat_deg: 47.401, lon_deg: 8.5, ground_amsl_m: null };
const draftOf = (kind: Draft['kind'], texts: Partial<Draft['texts']> = {}, more: Partial<Draft> = {}): Draft => ({
  kind,
  place: null,
  texts: { alt_home_m: '20', yaw_ned_deg: '90', speed_m_s: '3', radius_m: '20', behind_m: '5', above_m: '2', distance_m: '15', ...texts },
  clockwise: true,
  nose: 'vehicle',
  leader: '',
  followNose: 'keep',
  ...more,
});
const factsOf = (mode = 'hold', more: object = {}): VehicleFacts =>
  ({
    id: '1',
    name: 'Quad 1',
    lost: false,
    replayed: false,
    inAir: true,
    status: { value: { armed: true, mode, mode_label: mode } },
    globalPosition: { value: { ...HERE, alt_amsl_m: 510, alt_home_m: 10, heading_deg: 0 }, stale: false },
    home: { value: { ...HERE, alt_amsl_m: 500 } },
    orbit: null,
    offboard: null,
    ...more,
  }) as unknown as VehicleFacts;

describe('the values of a guided command', () => {
  it('are refused where PX4 would limit them, with its parameter', () => {
    expect(fieldProblem(draftOf('speed', { speed_m_s: '13' }), 'speed_m_s', LIMITS)).toBe('From 0.1 to 12 m/s (MPC_XY_VEL_MAX).');
    expect(fieldProblem(draftOf('orbit', { radius_m: '1500' }), 'radius_m', LIMITS)).toBe('From 1 to 1000 m (MC_ORBIT_RAD_MAX).');
    expect(fieldProblem(draftOf('orbit', { radius_m: '8', speed_m_s: '5' }), 'speed_m_s', LIMITS)).toBe('At 8 m the vehicle flies at most 4 m/s.');
    expect(orbitSpeedMax_m_s(8)).toBe(4);
    expect(fieldProblem(draftOf('speed', { speed_m_s: '13' }), 'speed_m_s', NO_LIMITS)).toBeNull();
  });
  it('must be numbers; speed and heading of a flight to a position may be left out', () => {
    for (const text of ['', 'abc', '1e999']) expect(fieldProblem(draftOf('altitude', { alt_home_m: text }), 'alt_home_m', LIMITS), text).not.toBeNull();
    expect(fieldProblem(draftOf('altitude', { alt_home_m: '12,5' }), 'alt_home_m', LIMITS)).toBeNull();
    const go = draftOf('go', { speed_m_s: '', yaw_ned_deg: '' }, { place: NORTH });
    expect(whyNot(go, factsOf(), LIMITS)).toBeNull();
  });
});

describe('what is flown in simulation before a command', () => {
  it('is the body of its own request', () => {
    expect(futuresOf(draftOf('altitude'), HERE)).toEqual({ altitude: { alt_home_m: 20 } });
    expect(futuresOf(draftOf('go', { yaw_ned_deg: '' }, { place: NORTH }), HERE)).toEqual({ goto: { ...HERE, alt_home_m: 20, speed_m_s: 3 } });
    const circle = { ...HERE, alt_home_m: 20, radius_m: 20, speed_m_s: 3, clockwise: true };
    expect(futuresOf(draftOf('orbit'), HERE)).toEqual({ orbit: circle });
    expect(futuresOf(draftOf('orbit', {}, { clockwise: false, nose: 'tangent' }), HERE)).toEqual({ orbit: { ...circle, clockwise: false, yaw: 'tangent' } });
    for (const kind of ['heading', 'speed', 'home', 'follow'] as const) expect(futuresOf(draftOf(kind), HERE), kind).toBeNull();
  });
});

describe('the geofence around home', () => {
  const FENCED: Limits = { ...LIMITS, fenceRadius_m: 100, fenceHeight_m: 25, fenceAction: 2 };
  const near = draftOf('orbit', { radius_m: '30' });

  it('is compared with circle, target and altitude, unless it does nothing', () => {
    expect(fenceText(near, factsOf(), FENCED)).toBe('');
    expect(fenceText(draftOf('orbit', { radius_m: '30' }, { place: NORTH }), factsOf(), FENCED)).toBe(
      'Up to 141 m from home: the geofence allows 100 m (GF_MAX_HOR_DIST).',
    );
    expect(fenceText(draftOf('go', { alt_home_m: '30' }, { place: NORTH }), factsOf(), FENCED)).toMatch(
      /^Up to 111 m .* Above the geofence, which allows 25 m/,
    );
    expect(fenceText(draftOf('altitude', { alt_home_m: '30' }), factsOf(), FENCED)).toContain('(GF_MAX_VER_DIST)');
    expect(fenceText(draftOf('altitude', { alt_home_m: '30' }), factsOf(), { ...FENCED, fenceAction: 0 })).toBe('');
    expect(fenceText(draftOf('altitude', { alt_home_m: '30' }), factsOf(), { ...FENCED, fenceHeight_m: 0 })).toBe('');
    expect(fenceText(draftOf('heading'), factsOf(), FENCED)).toBe('');
  });
  it('is drawn with the command and said in its confirmation', () => {
    expect(previewContent(near, factsOf(), LIMITS)?.lines.length).toBe(2);
    const drawn = previewContent(near, factsOf(), FENCED)?.lines.at(-1);
    expect(drawn).toMatchObject({ tone: 'caution', style: 'dashed' });
    expect(groundDistance_m(HERE, drawn?.positions[0] ?? HERE)).toBeCloseTo(100, 1);
    expect(confirmationTexts(draftOf('altitude', { alt_home_m: '30' }), factsOf(), FENCED).effect).toContain('Above the geofence');
  });
});

describe('a command', () => {
  it('says why it cannot be given', () => {
    const because = (draft: Draft, facts: VehicleFacts): string | null => whyNot(draft, facts, LIMITS);
    expect(because(draftOf('altitude'), factsOf('hold', { inAir: false }))).toContain('take off first');
    expect(because(draftOf('altitude'), factsOf('hold', { lost: true }))).toContain('No connection');
    expect(because(draftOf('altitude'), factsOf('hold', { replayed: true }))).toContain('replayed');
    expect(because(draftOf('speed'), factsOf('orbit'))).toContain('Hold and Mission');
    expect(because(draftOf('go'), factsOf())).toContain('Click on the map');
    expect(because(draftOf('home'), factsOf('rtl'))).toContain('Hold first');
    expect(because(draftOf('home'), factsOf('hold', { offboard: { streaming: true } }))).toContain('Hold first');
    expect(because(draftOf('home'), factsOf('hold', { inAir: false }))).toBeNull();
  });
  it('says its effect with numbers before', () => {
    expect(effectText(draftOf('altitude'), factsOf(), LIMITS)).toBe('Climbs 10.0 m to 20.0 m above home in about 3 s; a flight to a position continues.');
    expect(effectText(draftOf('altitude'), factsOf('mission'), LIMITS)).toContain('Leaves mission.');
    expect(effectText(draftOf('heading', { yaw_ned_deg: '270' }), factsOf(), LIMITS)).toContain('Turns 90° to the left to 270°, at up to 45 °/s');
    expect(effectText(draftOf('orbit'), factsOf(), LIMITS)).toContain(
      'Flies 20.0 m to a circle of 20 m radius at 20.0 m above home, and circles clockwise at 3 m/s, about 42 s a round',
    );
    expect(effectText(draftOf('go', {}, { place: NORTH }), factsOf(), LIMITS)).toMatch(/^Flies 111 m at 3 m\/s to 20\.0 m above home in about 37 s/);
    const home = effectText(draftOf('home', {}, { place: { ...NORTH, ground_amsl_m: 495 } }), factsOf(), LIMITS);
    expect(home).toContain('111 m from the present home. Return flies here and lands here, at 30 m above this home.');
    expect(home).toContain('the vehicle is then at 15.0 m');
  });
  it('is drawn before: the ring around the centre, the line to the position', () => {
    const ring = previewContent(draftOf('orbit', {}, { place: NORTH }), factsOf());
    for (const position of ring?.lines[0]?.positions ?? []) expect(groundDistance_m(NORTH, position)).toBeCloseTo(20, 1);
    expect(ring?.points[0]).toMatchObject({ mark: 'cross', lat_deg: NORTH.lat_deg });
    expect(previewContent(draftOf('go', {}, { place: NORTH }), factsOf())?.lines[0]?.positions.at(-1)).toMatchObject({
      lat_deg: NORTH.lat_deg,
      alt_amsl_m: 520,
    });
    expect(previewContent(draftOf('orbit', { radius_m: '' }), factsOf())).toBeNull();
  });
  it('says what is left, and its end', () => {
    const accepted = { draft: draftOf('altitude'), at: HERE };
    expect(progressOf(accepted, factsOf())).toEqual({ text: '10.0 m left.', ended: false });
    expect(progressOf(accepted, factsOf('rtl')).text).toBe('Interrupted: the vehicle is in rtl.');
    const orbit = { value: { ...NORTH, radius_m: 20, clockwise: false, alt_amsl_m: 520 }, stale: false };
    expect(progressOf({ draft: draftOf('orbit'), at: NORTH }, factsOf('orbit', { orbit })).text).toMatch(/^Orbit of 20 m, counter-clockwise: 111\.\d m/);
    expect(progressOf({ draft: draftOf('orbit'), at: NORTH }, factsOf('hold', { orbit })).ended).toBe(true);
  });
});

describe('the circle on the map', () => {
  const orbit = { value: { ...NORTH, radius_m: 20, clockwise: true, alt_amsl_m: 520 }, stale: false };
  it('is the one that the vehicle reports, in Orbit only and while it is new', () => {
    expect(flownCircle(factsOf('orbit', { orbit }))?.lines[0]?.style).toBe('solid');
    expect(flownCircle(factsOf('hold', { orbit }))).toBeNull();
    expect(flownCircle(factsOf('orbit', { orbit: { ...orbit, stale: true } }))).toBeNull();
  });
});

describe('the form', () => {
  const requests: { path: string; body: unknown }[] = [];
  let refusal: object | null = null;
  const answer = (path: string): object => (path.includes('/params/') ? { name: 'x', value: path.includes('RAD_MAX') ? 1000 : 12 } : {});
  const api = new ApiClient('p', undefined, (path, init) => {
    requests.push({ path: path.replace('/api/v1', ''), body: init.body === undefined ? null : JSON.parse(String(init.body)) });
    if (refusal !== null && init.body !== undefined) return Promise.resolve(new Response(JSON.stringify(refusal), { status: 409 }));
    return Promise.resolve(Response.json(answer(path)));
  });
  let now_s = 0;
  const actions = new ActionController(api, () => now_s, () => Promise.reject(new Error('not used')), () => factsOf()); // prettier-ignore
  const guided = new GuidedCommands(api, actions, () => factsOf());
  const confirm = async (): Promise<void> => {
    actions.confirmation?.slider.slide(1, now_s);
    actions.onFrame(null);
    await vi.waitFor(() => expect(actions.runningCommands).toEqual([]));
  };

  it('reads the limits once, sends exactly the shown values after the confirmation, and shows the progress', async () => {
    guided.open('orbit', factsOf(), { ...NORTH, ground_amsl_m: 480 });
    await vi.waitFor(() => expect(guided.limitsOf('1').returnAlt_m).toBe(12));
    guided.change({ clockwise: false, nose: 'center' });
    guided.enter('alt_home_m', '15');
    guided.request(factsOf());
    expect(requests.filter(({ body }) => body !== null)).toEqual([]);
    await confirm();
    const circle = { lat_deg: 47.401, lon_deg: 8.5, alt_home_m: 15, radius_m: 20, speed_m_s: 3, clockwise: false, yaw: 'center' };
    expect(requests.at(-1)).toEqual({ path: '/vehicles/1/orbit', body: circle });
    expect(guided.acceptedOf('1')?.draft.kind).toBe('orbit');
    expect(guided.acceptedOf('2')).toBeNull();
  });
  it('takes a click on the map as the position, and gives a drag back that was cancelled', () => {
    guided.open('home', factsOf());
    expect(guided.editor.press(NORTH)).toBe(true);
    expect(guided.draft.place).toMatchObject({ lat_deg: 47.401 });
    guided.editor.grab('target');
    guided.editor.drag('target', HERE);
    expect(guided.draft.place).toMatchObject(HERE);
    guided.editor.drop(false);
    expect(guided.draft.place).toMatchObject({ lat_deg: 47.401 });
  });
  it('asks again with the findings of the geofence that the server named, and then accepts exactly these', async () => {
    refusal = {
      code: 'plan_findings',
      detail: 'The circle leaves the vehicle’s geofence. Nothing was sent.',
      codes: ['fence_violation'],
      reasons: [],
      remedy: null,
    };
    guided.open('orbit', factsOf(), NORTH);
    now_s += 10;
    guided.request(factsOf());
    await confirm();
    expect(requests.at(-1)?.body).not.toHaveProperty('despite');
    refusal = null;
    now_s += 10;
    actions.acceptFindings('actionBar');
    expect(actions.confirmation === null ? '' : actions.textsFor(actions.confirmation).effect).toContain('You accept this finding: The circle leaves');
    await confirm();
    expect(requests.at(-1)?.body).toMatchObject({ despite: ['fence_violation'], radius_m: 20 });
  });
  it('turns the nose to a place: the heading follows clicks and drags, not the place after the command', () => {
    guided.open('heading', factsOf(), NORTH);
    expect(guided.draft.texts.yaw_ned_deg).toBe('0');
    expect(guided.editor.press({ lat_deg: 47.4, lon_deg: 8.501 })).toBe(true);
    expect(guided.draft.texts.yaw_ned_deg).toBe('90');
    expect(effectText(guided.draft, factsOf(), LIMITS)).toMatch(/Turns 90° to the right to 090°.*once: it does not follow it/);
    expect(guided.preview(factsOf())?.points).toMatchObject([{ lon_deg: 8.501 }]);
    guided.editor.grab('target');
    guided.editor.drag('target', { lat_deg: 47.399, lon_deg: 8.5 });
    expect(guided.draft.texts.yaw_ned_deg).toBe('180');
    guided.editor.drop(false);
    expect(guided.draft.texts.yaw_ned_deg).toBe('90');
    guided.editor.press(HERE);
    expect(whyNot(guided.draft, factsOf(), LIMITS)).toBe('Heading: enter a number.'); // no direction where the vehicle is
    guided.enter('yaw_ned_deg', '45');
    expect(guided.draft.place).toBeNull();
  });
  it('opens no confirmation for a value that cannot be sent', () => {
    guided.open('altitude', factsOf());
    guided.enter('alt_home_m', 'high');
    now_s += 10;
    actions.onFrame(null);
    guided.request(factsOf());
    expect(actions.confirmation).toBeNull();
  });
});

describe('following a vehicle', () => {
  const LEADER = factsOf('mission', { id: '2', name: 'Quad 2', globalPosition: { value: { ...NORTH, alt_amsl_m: 508, alt_home_m: 8 }, stale: false } });
  const follow = draftOf('follow', {}, { leader: '2' });

  it('needs a vehicle with a position, a distance of two metres, and no stream of its own', () => {
    expect(whyNot(follow, factsOf(), LIMITS, null)).toBe('Choose the vehicle to follow.');
    expect(whyNot(follow, factsOf(), LIMITS, { ...LEADER, lost: true })).toBe('The position of Quad 2 is not known.');
    expect(whyNot(draftOf('follow', { behind_m: '1', above_m: '1' }, { leader: '2' }), factsOf(), LIMITS, LEADER)).toContain('At least 2 m');
    expect(whyNot(follow, factsOf('offboard', { offboard: { streaming: true } }), LIMITS, LEADER)).toContain('Hold first');
    expect(whyNot(draftOf('follow', { behind_m: '300' }, { leader: '2' }), factsOf(), LIMITS, LEADER)).toBe('From -200 to 200 m.');
    expect(whyNot(follow, factsOf(), LIMITS, LEADER)).toBeNull();
  });

  it('says where the vehicle will be, and starts a stream with exactly that', () => {
    expect(effectText(follow, factsOf(), LIMITS, LEADER)).toMatch(/^Flies to Quad 2, 111 m away now, and stays 5 m behind, 2 m above in Offboard/);
    const actions = { request: vi.fn(), requestCommand: vi.fn() };
    const commands = new GuidedCommands(new ApiClient('p'), actions as unknown as ActionController, (id) =>
      id === '2' ? LEADER : id === '1' ? factsOf() : null,
    );
    commands.open('follow', factsOf());
    commands.request(factsOf());
    expect(actions.request).not.toHaveBeenCalled();
    commands.change({ leader: '2', followNose: 'face' });
    commands.enter('behind_m', '-6');
    commands.request(factsOf());
    const [action, facts, , , start] = actions.request.mock.calls[0] ?? [];
    expect([action, facts.id, start.setpoint]).toEqual(['offboard_start', '1', { type: 'follow', vehicle: '2', offset_frd_m: [6, 0, -2], yaw: 'face' }]);
    expect(start.text).toContain('6 m ahead, 2 m above');
    expect(start.validity.renew).toBe(true);
    expect(commands.acceptedOf('1')).toBeNull();
    start.onOutcome({ ok: true, value: null });
    expect(commands.acceptedOf('1')?.draft.leader).toBe('2');
  });

  it('ends with the stream', () => {
    const accepted = { draft: follow, at: HERE };
    const streaming = factsOf('offboard', { offboard: { streaming: true, type: 'trajectory', requestedType: 'follow' } });
    expect(progressOf(accepted, streaming, LEADER)).toEqual({ text: 'Follows Quad 2: 111 m away, 2.0 m above it.', ended: false });
    expect(progressOf(accepted, streaming, null)).toEqual({ text: 'Follows 2, whose position is not known.', ended: false });
    expect(progressOf(accepted, factsOf(), LEADER)).toEqual({ text: 'Following has ended: the vehicle is in hold.', ended: true });
  });

  it('never follows itself: another selected vehicle has to choose again', () => {
    const commands = new GuidedCommands(new ApiClient('p'), {} as ActionController, () => LEADER);
    commands.open('follow', factsOf());
    commands.change({ leader: '2' });
    commands.selectVehicle(LEADER);
    expect(commands.draft.leader).toBe('');
  });
});
