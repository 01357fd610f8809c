import { describe, expect, it, vi } from 'vitest';
import type { Outcome } from '../api/client';
import { ApiClient } from '../api/client';
import type { VehicleFacts } from '../vehicle/facts';
import type { Message, Reading } from '../live/vehicle-state';
import { confirmationTexts, type ActionFacts } from '../app/actions/actions';
import { ConfirmationSlider } from '../app/actions/confirmation';
import { ActionController } from '../app/actions/controller.svelte';
import { GimbalControl } from './gimbal/control.svelte';
import { QUANTITIES_BY_ID, CATALOGUE, searchValues, moveItem, readChoice, DEFAULT_IDS, type Source } from './instruments/catalogue';
import { severityName } from '../ui/severity';
import { fullTime, filterMessages, countUnread } from './messages/panel.svelte';
import { readOffboard, streamText } from '../vehicle/offboard';
import { batteryIndicator, componentLines, linkIndicator } from './status/indicators';
import { lossPercent } from './status/links.svelte';

const reading = <T>(value: T, stale = false): Reading<T> => ({ value, age_s: 0.2, stale });

function source(topics: Record<string, Record<string, unknown>>, stale = false): Source {
  const unknownReadings = {
    status: null,
    attitude: null,
    localPosition: null,
    globalPosition: null,
    hud: null,
    gps: null,
    battery: null,
    home: null,
    health: null,
    gimbal: null,
    orbit: null,
    offboard: null,
    control: null,
  };
  const facts: VehicleFacts = {
    id: '1',
    name: 'Quad 1',
    now_unix_s: 100,
    lost: false,
    offline: false,
    simulated: true,
    replayed: false,
    inAir: true,
    homeDistance_m: null,
    components: [],
    protocols: null,
    ...unknownReadings,
  };
  return { facts, flight: undefined, topic: (name) => (topics[name] === undefined ? null : reading(topics[name], stale)) };
}

describe('the catalogue of values', () => {
  it('has unique ids, a label for each value, and no quaternions', () => {
    expect(new Set(CATALOGUE.map((q) => q.id)).size).toBe(CATALOGUE.length);
    expect(CATALOGUE.length).toBeGreaterThan(50);
    for (const q of CATALOGUE) expect(q.label).toMatch(/^[A-Z±]/);
    expect(CATALOGUE.some((q) => q.id.includes('.q'))).toBe(false);
    for (const id of DEFAULT_IDS) expect(QUANTITIES_BY_ID.has(id)).toBe(true);
  });
  it('shows angles in degrees, and a dash for an unknown value', () => {
    const vehicleSource = source({
      attitude: { roll_rad: Math.PI / 6 },
      motors: { pwm_us: [1500] },
      battery: { voltage_v: null },
      global_position: { lat_deg: 47.3977421 },
    });
    const read = (id: string) => QUANTITIES_BY_ID.get(id)?.read(vehicleSource);
    expect(read('attitude.roll_rad')).toMatchObject({ text: '30.0', unit: '°', stale: false });
    expect(read('motors.pwm_us.0')).toMatchObject({ text: '1500', unit: 'µs' });
    expect(read('motors.pwm_us.3')?.text).toBe('–');
    expect(read('battery.voltage_v')?.text).toBe('–');
    expect(read('global_position.lat_deg')?.text).toBe('47.397742');
    expect(read('hud.climb_m_s')).toMatchObject({ text: '–', age_s: null });
    expect(read('flown.climb')?.text).toBe('–');
  });
  it('shows the age of an old value', () => {
    expect(QUANTITIES_BY_ID.get('gps.hdop')?.read(source({ gps: { hdop: 0.8 } }, true))).toMatchObject({ text: '0.80', stale: true, age_s: 0.2 });
  });
  it('reads the stored order, without values that do not exist', () => {
    expect(readChoice(null)).toEqual(DEFAULT_IDS);
    expect(readChoice(['gps.hdop', 'gone.field', 'gps.hdop', 'flown.climb'])).toEqual(['gps.hdop', 'flown.climb']);
    expect(readChoice([])).toEqual([]);
    expect(moveItem(['a', 'b', 'c'], 0, 2)).toEqual(['b', 'c', 'a']);
    expect(moveItem(['a', 'b', 'c'], 2, 0)).toEqual(['c', 'a', 'b']);
    expect(moveItem(['a'], 4, 0)).toEqual(['a']);
  });
  it('finds values by name, unit and group, except values that are already chosen', () => {
    expect(searchValues('battery volt', []).map((q) => q.id)).toContain('battery.voltage_v');
    expect(searchValues('battery volt', ['battery.voltage_v']).map((q) => q.id)).not.toContain('battery.voltage_v');
    expect(searchValues('µs', []).every((q) => q.group === 'Motors')).toBe(true);
    expect(searchValues('no such thing', [])).toEqual([]);
  });
});

describe('messages', () => {
  const message = (unix_s: number, severity: number): Message => ({ key: `${unix_s}`, unix_s, severity, kind: 'event', text: 'x' });
  const messages = [message(9, 6), message(8, 4), message(7, 7), message(6, 2)];
  it('are filtered by severity', () => {
    expect(filterMessages(messages, 9, 'errors').map((m) => m.unix_s)).toEqual([6]);
    expect(filterMessages(messages, 9, 'warnings').map((m) => m.unix_s)).toEqual([8, 6]);
    expect(filterMessages(messages, 9).map((m) => m.unix_s)).toEqual([9, 8, 6]);
    expect(filterMessages(messages, 9, 'debug')).toHaveLength(4);
  });
  it('are counted until a person reads them, with the tone of the most severe message', () => {
    expect(countUnread(messages, 5)).toEqual({ count: 3, tone: 'danger' });
    expect(countUnread(messages, 7)).toEqual({ count: 2, tone: 'caution' });
    expect(countUnread(messages, 9)).toEqual({ count: 0, tone: 'dim' });
  });
  it('have a shape in addition to the colour, and a time with its date', () => {
    expect([2, 4, 6].map((s) => severityName(s).shape)).toEqual(['square', 'triangle', 'dot']);
    expect(severityName(6).fullName).toBe('Info');
    expect(fullTime(1_700_000_000.25)).toMatch(/^2023-11-1[45] \d\d:\d\d:20\.2$/);
  });
});

describe('the offboard stream', () => {
  it('has a text for each of its states', () => {
    for (const state of ['idle', 'starting', 'interrupted', 'holding', 'to_hold', 'landing', 'undoing']) {
      const status = readOffboard({ streaming: false, state, setpoint: null });
      expect(status && streamText(status)).not.toContain('NED');
    }
    const streaming = readOffboard({ streaming: true, state: 'streaming', setpoint: { type: 'velocity', velocity_ned_m_s: [1, 0, 0] } });
    expect(streaming && streamText(streaming)).toBe('Velocity setpoints');
    const groupStream = readOffboard({ streaming: true, state: 'streaming', owner: 'group', setpoint: { type: 'velocity', velocity_ned_m_s: [1, 0, 0] } });
    expect(groupStream && streamText(groupStream)).toBe('Group · Velocity setpoints');
  });
});

describe('the link', () => {
  it('counts recent packet loss and shows a weak link', () => {
    expect(lossPercent({ received: 100, lost: 50 }, { received: 190, lost: 60 })).toBe(10);
    expect(lossPercent({ received: 100, lost: 0 }, { received: 100, lost: 0 })).toBeNull();
    expect(linkIndicator(0.2, false, [], '5 kB/s', 10)).toMatchObject({ problem: 'weak', severity: 'caution' });
    expect(linkIndicator(0.2, false, [], '5 kB/s', null)).toMatchObject({ problem: '', severity: 'none' });
    expect(linkIndicator(9, true, [], '5 kB/s', 10)).toMatchObject({ text: 'lost 9 s ago', problem: '', severity: 'danger' });
  });
  it('lists the vehicle’s other components, and whether they are connected', () => {
    const camera = { component_id: 100, kind: 'camera', mav_type: 30, lost: false, last_heard_unix_s: null };
    const lostGimbal = { ...camera, component_id: 154, kind: 'gimbal', lost: true, last_heard_unix_s: 80 };
    expect(componentLines([{ ...camera, component_id: 1, kind: 'autopilot' }, camera, lostGimbal], 100)).toEqual([
      ['Camera 100', 'connected'],
      ['Gimbal 154', 'connection lost 20 s ago'],
    ]);
  });
});

describe('the battery', () => {
  it('shows its lowest cell', () => {
    const value = {
      remaining_percent: 50,
      voltage_v: 12,
      current_a: 3,
      consumed_mah: 200,
      time_remaining_s: 240,
      cell_voltages_v: [4.02, 3.91, 4.01],
      battery_id: 0,
      batteries: [],
    };
    expect(batteryIndicator(reading(value)).details).toContainEqual(['Lowest cell', '3.91 V, cell 2 of 3']);
    expect(batteryIndicator(reading({ ...value, cell_voltages_v: null })).details).toContainEqual(['Cells', '–']);
  });
  it('lists each battery', () => {
    const battery = { battery_id: 0, remaining_percent: 50, voltage_v: 12, current_a: 3, consumed_mah: 200, time_remaining_s: 240, cell_voltages_v: null };
    const value = { ...battery, batteries: [battery, { ...battery, battery_id: 1, remaining_percent: 44, current_a: null }] };
    const details = batteryIndicator(reading(value)).details;
    expect(details).toContainEqual(['Battery 1', '50 % · 12.00 V · 3.0 A']);
    expect(details).toContainEqual(['Battery 2', '44 % · 12.00 V']);
  });
});

const actionFacts: ActionFacts = {
  vehicleId: '1',
  vehicleName: 'Quad 1',
  armed: true,
  inAir: true,
  alt_home_m: 12,
  homeDistance_m: 48,
  mode: 'hold',
  streaming: false,
  takeoffAlt_home_m: 10,
  battery_percent: null,
};

describe('a confirmation', () => {
  it('shows the return altitude once the parameter has been read', () => {
    expect(confirmationTexts('rtl', actionFacts)?.effect).toContain('Climbs to the return altitude, flies');
    expect(confirmationTexts('rtl', { ...actionFacts, returnAlt_home_m: 60 })?.effect).toContain(
      'the return altitude, 60 m above home (lower near home), flies',
    );
    expect(confirmationTexts('rtl', { ...actionFacts, returnAlt_home_m: 10 })?.effect).toContain('Stays at 12.0 m');
  });
  it('cannot be confirmed while its value is invalid', () => {
    const confirmation = new ConfirmationSlider(false, 0);
    confirmation.blocked = true;
    confirmation.pressKey(0);
    confirmation.slide(1, 0.5);
    expect(confirmation.updatePhase(2)).toBe('asking');
    expect(confirmation.remaining_s(2)).toBe(3.5); // an attempt to confirm restarts the timeout
    confirmation.blocked = false;
    confirmation.slide(1, 2);
    expect(confirmation.updatePhase(2)).toBe('confirmed');
  });
  it('shows the progress only on the page that sent the command', async () => {
    let respond: (outcome: Outcome<unknown>) => void = () => undefined;
    const api = new ApiClient(
      { name: 'Anna', id: 'tab', key: 'k7' },
      undefined,
      () => new Promise<Response>((resolve) => (respond = () => resolve(new Response('{}')))),
    );
    const { facts } = source({});
    const actions = new ActionController(
      api,
      () => 0,
      () => Promise.reject(new Error('not requested')),
      () => facts,
    );
    actions.request('hold', facts);
    expect(actions.runningCommands.map((r) => [r.action, r.progressText])).toEqual([['hold', null]]);
    const progress = {
      kind: 'progress',
      vehicle: '1',
      unix_s: 1,
      severity: 7,
      text: 'Commanding vehicle 1 to hold (attempt 2)',
      command: 'hold',
      fraction: 0.5,
    };
    actions.handleEvent({ ...progress, client: 'Anna', client_key: 'k8' }); // another tab with the same name
    expect(actions.runningCommands[0]?.progressText).toBeNull();
    actions.handleEvent({ ...progress, client: 'Anna', client_key: 'k7' });
    expect(actions.runningCommands[0]).toMatchObject({ progressText: progress.text, fraction: 0.5 });
    await Promise.resolve();
    respond({ ok: true, value: null });
    await new Promise((r) => setTimeout(r));
    expect(actions.runningCommands).toEqual([]);
  });
  it('rejects an altitude that the server would refuse', () => {
    const { facts } = source({});
    const actions = new ActionController(
      new ApiClient('p'),
      () => 0,
      () => Promise.reject(new Error('not requested')),
      () => facts,
    );
    actions.request('takeoff', { ...facts, inAir: false });
    for (const invalid of [NaN, 0, 121]) {
      actions.enterTakeoffAltitude(invalid);
      expect(actions.takeoffProblem).toContain('from 1 to 120 m');
      expect(actions.confirmation?.slider.blocked).toBe(true);
    }
    actions.enterTakeoffAltitude(25);
    expect(actions.takeoffProblem).toBeNull();
    expect(actions.confirmation?.slider.blocked).toBe(false);
    actions.stepTakeoffAltitude(1000);
    expect(actions.takeoffAlt_home_m).toBe(120);
  });
});

describe('the gimbal', () => {
  it('shows the limit at which the camera stopped, from the last command until the next command', async () => {
    vi.useFakeTimers();
    const { facts } = source({});
    const requests: { path: string; wait?: boolean }[] = [];
    const api = new ApiClient('p', undefined, async (path, init) => {
      const body = JSON.parse(init.body as string) as { wait?: boolean };
      requests.push({ path: path.split('/').at(-1) ?? '', ...('wait' in body ? { wait: body.wait as boolean } : {}) });
      return Promise.resolve(
        Response.json({ limited: body.wait === true ? { text: 'The gimbal stopped at its own limit: pitch -45° instead of -90°.' } : null }),
      );
    });
    const gimbal = new GimbalControl(
      api,
      new ActionController(
        api,
        () => 0,
        () => Promise.reject(new Error('not requested')),
        () => facts,
      ),
    );
    for (const pitch_deg of [-70, -80, -90]) gimbal.point(facts, { pitch_deg, yaw_deg: 0 });
    await vi.advanceTimersByTimeAsync(300);
    expect(gimbal.limitNoticeOf(facts)).toBeNull();
    await vi.advanceTimersByTimeAsync(200);
    expect(requests.at(-1)).toEqual({ path: 'angles', wait: true });
    expect(gimbal.limitNoticeOf(facts)).toContain('pitch -45°');
    gimbal.turn(facts, 1, 0);
    expect(gimbal.limitNoticeOf(facts)).toBeNull();
    await vi.advanceTimersByTimeAsync(1000);
    expect(requests.filter((request) => request.wait === true)).toHaveLength(1);
    gimbal.point(facts, { pitch_deg: -90, yaw_deg: 0 });
    await vi.advanceTimersByTimeAsync(399);
    gimbal.stop(); // the arrow was released: the stop does not wait for the response to the angles
    await vi.advanceTimersByTimeAsync(1000);
    expect(requests.at(-1)).toEqual({ path: 'rates' });
    expect(gimbal.limitNoticeOf(facts)).toBeNull();
    vi.useRealTimers();
  });
});
