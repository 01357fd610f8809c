import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../../api/client';
import { CommandQueue } from '../../../api/command-queue';
import { CommandGate, type Command } from '../../../app/actions/command.svelte';
import type { Refusal } from '../../../app/actions/controller.svelte';
import { UNKNOWN_IDENTITY } from '../../../live/vehicle-state';
import {
  isCommandable,
  distanceTone,
  findingsShown,
  joinNames,
  memberLabel,
  nearestPair,
  newestEnded,
  readGroup,
  separationText,
  stateLabel,
  validLeft_s,
  withGroup,
  groupKey,
  type Group,
  type ReceivedGroup,
} from './group';
import { GroupController } from './groups.svelte';
import { GroupRenewer, type GroupRenewalResult } from './renewer';
import { motionOf } from './group-form';
import { vehicle } from './vehicle.fixture';

const GROUP: Group = {
  id: '1',
  state: 'flying',
  mission: null,
  client: 'Anna',
  client_key: 'me',
  minimum_separation_m: 5,
  margin_m: 1.6,
  others_go_on: false,
  created_unix_s: 100,
  start_unix_s: 110,
  valid_left_s: 4,
  members: ['1', '2'].map((id) => ({ vehicle: id, role: null, ordered_type: 'position', stream: 'streaming', mode: 'offboard', held: false })),
  nearest: { vehicles: ['1', '2'], distance_m: 7 },
  findings: [],
  ended: null,
};
const groupWith = (more: Partial<Group>): Group => ({ ...GROUP, ...more });

describe('a group’s state', () => {
  it('counts down to the start, and subtracts the age of the data from the remaining validity', () => {
    expect(stateLabel(groupWith({ state: 'waiting' }), 107.5).text).toBe('Waiting, starts in 2.5 s');
    expect(stateLabel(groupWith({ state: 'waiting', start_unix_s: null }), 107).text).toBe('Waiting, starts in – s');
    expect(validLeft_s({ group: GROUP, receivedAt_s: 50 }, 51.5)).toBe(2.5);
    expect(validLeft_s({ group: GROUP, receivedAt_s: 50 }, 60)).toBe(0);
    expect(validLeft_s({ group: groupWith({ valid_left_s: null }), receivedAt_s: 50 }, 51)).toBeNull();
  });

  it('shows stream and mode of each member, in amber if the member does not follow the group', () => {
    const [member] = GROUP.members;
    if (member === undefined) throw new Error('no member');
    expect(memberLabel(member, 'Offboard')).toEqual({ text: 'position setpoints · Offboard', tone: 'dim' });
    expect(memberLabel({ ...member, held: true, mode: 'hold' }, 'Hold')).toEqual({ text: 'in Hold', tone: 'caution' });
    expect(memberLabel({ ...member, held: true, mode: 'land' }, null)).toEqual({ text: 'left the group · land', tone: 'caution' });
    expect(memberLabel({ ...member, stream: 'holding' }, 'Offboard').tone).toBe('caution');
    expect(memberLabel(member, 'Offboard', true).text).toBe('waiting · Offboard');
    const inMission = { ...member, role: 'lead', ordered_type: 'mission', stream: 'idle', mode: 'takeoff' };
    expect(memberLabel(inMission, 'Takeoff')).toEqual({ text: 'lead · Takeoff', tone: 'dim' });
    expect(memberLabel({ ...inMission, held: true, mode: 'hold' }, 'Hold').text).toBe('in Hold');
    expect(stateLabel(groupWith({ mission: 'Show' }), 0).text).toBe('Flying the mission “Show”');
    expect([4.9, 6, 6.3].map((d) => distanceTone(d, 5))).toEqual(['danger', 'caution', 'ok']);
  });

  it('shows the separation margin once the server has measured it', () => {
    expect(separationText(GROUP)).toBe('minimum 5.0 m + 1.6 m margin');
    expect(separationText(groupWith({ margin_m: null }))).toBe('minimum 5.0 m');
  });

  it('lists findings newest first, without the finding that repeats the end reason', () => {
    const finding = (text: string): Group['findings'][number] => ({ unix_s: 1, code: 'left', vehicles: ['1'], held: [], text, distance_m: null });
    const group = groupWith({ findings: ['a', 'b', 'c', 'd'].map(finding) });
    expect(findingsShown(group, 3).map((f) => f.text)).toEqual(['d', 'c', 'b']);
    expect(findingsShown({ ...group, state: 'ended', ended: 'd' }, 3).map((f) => f.text)).toEqual(['c', 'b']);
  });

  it('finds the two nearest vehicles with known positions', () => {
    const [a, b, c] = [vehicle('1', null), vehicle('2', null, 47.0002), vehicle('3', null, 47.0003)];
    expect(nearestPair([a, b, c])).toMatchObject({ vehicles: ['2', '3'], distance_m: expect.closeTo(11.1, 1) as number });
    expect(nearestPair([a, { ...b, globalPosition: null }])).toBeNull();
    expect(joinNames(['a', 'b', 'c'])).toBe('a, b and c');
  });

  it('distinguishes groups with the same number by their creation time, and shows an ended group only if this page saw it flying', () => {
    const earlierGroup = groupWith({ state: 'ended', created_unix_s: 1, ended: 'x' });
    const groups: ReceivedGroup[] = withGroup([{ group: earlierGroup, receivedAt_s: 0 }], { group: GROUP, receivedAt_s: 1 });
    expect(groups).toHaveLength(2);
    const endedGroups = withGroup(groups, { group: groupWith({ state: 'ended', ended: 'me commanded Hold.' }), receivedAt_s: 2 });
    expect(endedGroups).toHaveLength(2);
    expect(newestEnded(endedGroups, new Set([groupKey(GROUP)]))?.ended).toBe('me commanded Hold.');
    expect(newestEnded(endedGroups, new Set())).toBeNull();
    expect(newestEnded([{ group: groupWith({ state: 'ended', start_unix_s: null }), receivedAt_s: 0 }], new Set([groupKey(GROUP)]))).toBeNull();
  });

  it('is read only from valid data, and its members are PX4 multicopters', () => {
    const quad = { ...UNKNOWN_IDENTITY, autopilot: 12, vehicle_type: 2 };
    expect([quad, { ...quad, autopilot: 3 }, { ...quad, vehicle_type: 1 }, { ...quad, replayed: true }, UNKNOWN_IDENTITY].map(isCommandable)).toEqual([
      true,
      false,
      false,
      false,
      false,
    ]);
    expect(readGroup(GROUP)).toBe(GROUP);
    expect([null, undefined, 'x', { id: '1' }].map(readGroup)).toEqual([null, null, null, null]);
  });
});

describe('the group renewer', () => {
  const VALIDITY = { valid_for_s: 10, on_expiry: { action: 'hold', hold_for_s: 5 }, renew: true } as const;
  function setup(results: GroupRenewalResult[] = []): { renewedAt_s: number[]; renewer: GroupRenewer; clock: { now_s: number } } {
    const renewedAt_s: number[] = [];
    const clock = { now_s: 0 };
    const renewer = new GroupRenewer(() => {
      renewedAt_s.push(clock.now_s);
      return Promise.resolve(results.shift() ?? 'accepted');
    });
    renewer.start(GROUP, VALIDITY, 0);
    return { renewedAt_s, renewer, clock };
  }
  async function run(
    { renewer, clock }: ReturnType<typeof setup>,
    until_s: number,
    groups: (s: number) => Group[],
    visible: (s: number) => boolean = () => true,
  ): Promise<void> {
    for (; clock.now_s < until_s; clock.now_s += 1) {
      renewer.renewIfDue(clock.now_s, groups(clock.now_s), visible(clock.now_s));
      await Promise.resolve();
      await Promise.resolve();
    }
  }

  it('renews after 0.3 of the validity, and only while the page is visible', async () => {
    const harness = setup();
    await run(
      harness,
      20,
      () => [GROUP],
      (s) => s < 8 || s > 15,
    );
    expect(harness.renewedAt_s).toEqual([3, 6, 16, 19]);
  });

  it('does not renew a group before its start, while it switches to Hold, or after its end', async () => {
    const harness = setup();
    await run(harness, 30, (s) => [groupWith({ state: s < 10 ? 'waiting' : s < 12 ? 'flying' : s < 14 ? 'holding' : 'flying' })]);
    expect(harness.renewedAt_s).toEqual([10]);
    const otherGroup = setup();
    await run(otherGroup, 10, () => [groupWith({ created_unix_s: 999 })]);
    expect(otherGroup.renewedAt_s).toEqual([]);
    expect(otherGroup.renewer.isRenewing(GROUP)).toBe(false);
  });

  it('retries without an answer, but not after a refusal', async () => {
    const harness = setup(['no answer', 'refused']);
    await run(harness, 30, () => [GROUP]);
    expect(harness.renewedAt_s).toEqual([3, 6]);
  });

  it('does not renew a group for which renewal is off', async () => {
    const harness = setup();
    harness.renewer.start(GROUP, { ...VALIDITY, renew: false }, 0);
    await run(harness, 30, () => [GROUP]);
    expect(harness.renewedAt_s).toEqual([]);
  });
});

describe('the group controller', () => {
  const VALIDITY = { valid_for_s: 10, on_expiry: { action: 'hold', hold_for_s: 5 }, renew: true } as const;
  const MEMBERS = ['1', '2'].map((vehicle) => ({ vehicle, setpoint: { type: 'velocity', velocity_ned_m_s: [1, 0, 0] } }));

  function setup(): {
    controller: GroupController;
    calls: { call: string; body: unknown }[];
    fakes: { now_s: number; visible: boolean; group: Group; status: number; response: Promise<void> };
    stoppedRenewals: string[];
    refused: Refusal[];
    settle: () => Promise<void>;
  } {
    const calls: { call: string; body: unknown }[] = [];
    const fakes = { now_s: 0, visible: true, group: GROUP, status: 200, response: Promise.resolve() };
    const api = new ApiClient({ name: 'Anna', id: 'tab', key: 'me' }, undefined, (path, init) => {
      calls.push({
        call: `${init.method ?? ''} ${path.replace('/api/v1', '')}`,
        body: init.body === undefined ? null : (JSON.parse(init.body as string) as unknown),
      });
      const body = path.endsWith('/groups') && init.method === 'GET' ? { groups: [fakes.group] } : fakes.group;
      const reply =
        fakes.status === 200 ? Response.json(body) : Response.json({ code: 'not_in_control', detail: 'x has control of vehicle 1.' }, { status: fakes.status });
      return init.method === 'POST' ? fakes.response.then(() => reply) : Promise.resolve(reply);
    });
    const refused: Refusal[] = [];
    const stoppedRenewals: string[] = [];
    const actions = {
      attempt: async ({ name, vehicleNames, send }: Command): Promise<boolean> => {
        const outcome = await send([], new CommandGate().fix([]));
        if (!outcome.ok) refused.push({ commandName: name, vehicleName: vehicleNames, problem: outcome.problem });
        return outcome.ok;
      },
      showProblem: (commandName: string, vehicleName: string, _pagePart: string, problem: Refusal['problem']): void =>
        void refused.push({ commandName, vehicleName, problem }),
    };
    const controller = new GroupController(
      api,
      new CommandQueue(),
      actions,
      () => fakes.now_s,
      () => fakes.visible,
      (id) => `Quad ${id}`,
      (id) => stoppedRenewals.push(id),
    );
    const settle = async (): Promise<void> => void (await new Promise((done) => setTimeout(done, 0)));
    return { controller, calls, fakes, stoppedRenewals, refused, settle };
  }

  it('renews each member’s setpoint, except for members that got a setpoint outside the group', async () => {
    const { controller, calls, fakes, stoppedRenewals, settle } = setup();
    expect((await controller.start({ members: MEMBERS }, VALIDITY)).ok).toBe(true);
    expect(stoppedRenewals).toEqual(['1', '2']);
    expect([controller.pageGroup?.group.id, controller.renewedKey, controller.groupWith('2')?.id, controller.groupWith('3')]).toEqual([
      '1',
      groupKey(GROUP),
      '1',
      null,
    ]);
    const renewals = (): unknown[] => calls.filter((c) => c.call === 'POST /groups/1/setpoints').map((c) => (c.body as { setpoints: unknown }).setpoints);
    fakes.now_s = 3;
    controller.onTelemetry('open');
    await settle();
    controller.onVehicleSetpoint('1');
    fakes.now_s = 6;
    controller.onTelemetry('open');
    await settle();
    expect(renewals()).toEqual([MEMBERS, [MEMBERS[1]]]);
    fakes.visible = false;
    fakes.now_s = 20;
    controller.onTelemetry('open');
    await settle();
    expect(renewals()).toHaveLength(2);
  });

  it('sends no renewal that could overtake a new setpoint', async () => {
    const { controller, calls, fakes, settle } = setup();
    await controller.start({ members: MEMBERS }, VALIDITY);
    const delayResponse = (): (() => void) => {
      let respond = (): void => undefined;
      fakes.response = new Promise((done) => (respond = done));
      return respond;
    };
    const posts = (): unknown[] => calls.filter((c) => c.call === 'POST /groups/1/setpoints').map((c) => c.body);
    const newSetpoints = MEMBERS.map(({ vehicle }) => ({ vehicle, setpoint: { type: 'velocity', velocity_ned_m_s: [0, 2, 0] } }));

    // New setpoints while the server has not answered a renewal: the request waits for the response to the renewal.
    const respondToRenewal = delayResponse();
    fakes.now_s = 3;
    controller.onTelemetry('open');
    await settle();
    const sendOutcome = controller.send(GROUP, newSetpoints, { ...VALIDITY, valid_for_s: 30 });
    await settle();
    expect(posts()).toEqual([{ setpoints: MEMBERS, valid_for_s: 10, on_expiry: VALIDITY.on_expiry }]);
    respondToRenewal();
    const respondToSetpoints = delayResponse();
    await settle();
    expect(posts().slice(1)).toEqual([{ setpoints: newSetpoints, valid_for_s: 30, on_expiry: VALIDITY.on_expiry }]);

    // Until the server has accepted the new setpoints, no renewal is sent; the next renewal sends the new setpoints with their validity.
    fakes.now_s = 8;
    controller.onTelemetry('open');
    await settle();
    respondToSetpoints();
    expect((await sendOutcome).ok).toBe(true);
    controller.onTelemetry('open');
    await settle();
    expect(posts()).toHaveLength(2);
    fakes.now_s = 17.5;
    controller.onTelemetry('open');
    await settle();
    expect(posts()[2]).toEqual(posts()[1]);

    // Without a response it is unknown which setpoints the server accepted, and this page renews none.
    fakes.response = Promise.reject(new TypeError('network'));
    expect((await controller.send(GROUP, MEMBERS, VALIDITY)).ok).toBe(false);
    fakes.response = Promise.resolve();
    fakes.now_s = 60;
    controller.onTelemetry('open');
    await settle();
    expect([posts().length, controller.renewedKey]).toEqual([4, null]);
  });

  it('polls once a second while there is a group and the page is visible, and after each new connection', async () => {
    const { controller, calls, fakes, settle } = setup();
    const pollCount = (): number => calls.filter((c) => c.call === 'GET /groups').length;
    for (; fakes.now_s < 2.95; fakes.now_s += 0.1) {
      controller.onTelemetry('open');
      await settle();
    }
    expect(pollCount()).toBe(3);
    fakes.group = groupWith({ state: 'ended', ended: 'me commanded Hold.' });
    controller.handleEvent({ kind: 'group', vehicle: null, unix_s: 0, severity: 6, text: '', group: fakes.group });
    expect([controller.activeGroups.length, controller.lastEndedGroup?.ended, controller.pageGroup]).toEqual([0, 'me commanded Hold.', null]);
    fakes.now_s = 60;
    controller.onTelemetry('open');
    await settle();
    expect(pollCount()).toBe(3);
    controller.onTelemetry('another connection');
    await settle();
    expect(pollCount()).toBe(4);
    controller.dismissEnded();
    expect(controller.lastEndedGroup).toBeNull();
  });

  it('shows why a renewal was refused, and stops renewing', async () => {
    const { controller, fakes, refused, calls, settle } = setup();
    await controller.start({ members: MEMBERS }, VALIDITY);
    fakes.status = 409;
    for (const now_s of [3, 6, 9]) {
      fakes.now_s = now_s;
      controller.onTelemetry('open');
      await settle();
    }
    expect(refused.map((r) => [r.commandName, r.vehicleName, r.problem.detail])).toEqual([
      ['Renewing group 1', 'Quad 1, Quad 2', 'x has control of vehicle 1.'],
    ]);
    expect(calls.filter((c) => c.call.endsWith('setpoints'))).toHaveLength(1);
    expect(controller.renewedKey).toBeNull();
  });

  it('reads from the setpoint types whether a group moves together or flies a velocity', () => {
    expect(motionOf(GROUP)).toBe('move');
    expect(motionOf(groupWith({ members: GROUP.members.map((m) => ({ ...m, ordered_type: 'velocity' })) }))).toBe('velocity');
  });
});
