import { describe, expect, it } from 'vitest';
import { ApiClient } from '../api/client';
import { Turns } from '../api/turns';
import type { Status } from '../live/topics';
import { call, question, unavailable, type ActionFacts, type ActionName } from '../app/actions/actions';
import { Confirmation, EXPIRES_AFTER_S, HOLD_DANGER_S, HOLD_S, KNOB_STEPS } from '../app/actions/confirmation';
import { LatestSender } from './gimbal/latest';
import { owner } from './gimbal/owner';
import { limits } from '../vehicle/gimbal';
import { angleWords, clamp, stepped, toAngles, toPoint } from './gimbal/pad';
import { horizonTransform, tapeTicks } from './instruments/attitude';
import { severityWord } from '../ui/severity';
import { shown } from './messages/messages';
import { OffboardControl } from './offboard/control.svelte';
import { SetpointKeeper, type Said } from './offboard/keeper';
import { LASTING, nudge, STEPS, type PositionSetpoint } from '../vehicle/setpoint';
import { error_m, limitsNotice, nudgeBase, readOffboard } from '../vehicle/offboard';
import { batteryIndicator, gpsIndicator } from './status/indicators';
import { linkDetails, recordingIndicator, type LinkLine } from './status/links';
import { statusWords, type StatusFacts } from './status/status-words';

const status = (over: Partial<Status> = {}): Status => ({
  armed: true,
  mode: 'hold',
  mode_label: 'Hold',
  custom_mode: 1,
  intended_custom_mode: null,
  landed_state: 'in_air',
  system_status: 4,
  link_lost: false,
  last_heartbeat_age_s: 0.2,
  ...over,
});
const words = (over: Partial<StatusFacts>) => statusWords({ status: status(), age_s: 0.1, lost: false, replayed: false, ready: null, stream: null, ...over });

describe('status words', () => {
  it('says who makes it fly', () => {
    expect(words({ status: status({ mode: 'offboard' }), stream: { type: 'position', rate_hz: 49.8, client: 'a' } })).toEqual({
      title: 'Offboard',
      who: 'server streams position, 50 Hz for a',
      tone: 'target',
    });
    expect(words({ status: status({ mode: 'offboard' }) }).who).toContain('another computer');
    expect(words({ status: status({ mode: 'position' }) }).who).toContain('pilot');
    expect(words({ status: status({ mode: 'new_one', mode_label: 'New one' }) }).title).toBe('New one');
  });
  it('does not call ready what has not said so', () => {
    const down = status({ armed: false, landed_state: 'on_ground' });
    expect(words({ status: down, ready: true }).title).toBe('Ready');
    expect(words({ status: down, ready: false })).toMatchObject({ title: 'Not ready', tone: 'caution' });
    expect(words({ status: down }).title).toBe('Disarmed');
    expect(words({ status: null }).title).toBe('No vehicle state');
  });
  it('puts lost, replay and failsafe before the mode', () => {
    expect(words({ lost: true, age_s: 7 })).toMatchObject({ title: 'Connection lost', who: '7 s ago · last: Hold, armed', tone: 'danger' });
    expect(words({ lost: true, offline: true, age_s: 7 })).toMatchObject({ title: 'No connection to the server', who: 'last: Hold, armed' });
    expect(words({ replayed: true }).title).toBe('Replay');
    expect(words({ status: status({ mode: 'land', custom_mode: 2, intended_custom_mode: 9 }) }).title).toBe('Failsafe: Landing');
  });
});

const facts: ActionFacts = {
  vehicleId: '1',
  vehicleName: '1 Quad',
  armed: true,
  inAir: true,
  alt_home_m: 12.44,
  fromHome_m: 48.2,
  mode: 'offboard',
  streaming: true,
  takeoffAlt_home_m: 10,
  battery_percent: 82,
};

describe('actions', () => {
  it('name vehicle, action and effect with numbers', () => {
    expect(question('rtl', facts)).toMatchObject({ title: 'Return 1 Quad', effect: expect.stringContaining('48.2 m back') });
    expect(question('rtl', facts)?.effect).toContain('Offboard ends.');
    expect(question('takeoff', { ...facts, armed: false })?.effect).toBe('Arms, climbs to 10.0 m above home and holds there. Battery 82 %.');
    expect(question('land', { ...facts, fromHome_m: null })?.effect).toContain('an unknown distance');
  });
  it('say that the vehicle falls, and confirm in the words the server wants', () => {
    expect(question('kill', facts)).toMatchObject({ danger: true, effect: expect.stringContaining('will fall from 12.4 m') });
    expect(question('kill', { ...facts, inAir: false })?.effect).toContain('it will fall');
    expect(call('kill', { ...facts, vehicleId: '1~2' })).toEqual({ path: '/vehicles/1~2/kill', body: { confirm: 'motors stop, vehicle 1~2 falls' } });
  });
  it('never ask before Hold and never disable it or Stop motors for a vehicle', () => {
    expect(question('hold', facts)).toBeNull();
    const worst = { ...facts, lost: true, replayed: false };
    for (const action of ['hold', 'kill'] as ActionName[]) expect(unavailable(action, worst)).toBeNull();
    expect(unavailable('land', worst)).not.toBeNull();
    expect(unavailable('takeoff', { ...facts, lost: false, replayed: false })).toBe('It is in the air.');
  });

  it('say of a recording that it takes no commands, whatever is pressed', () => {
    for (const action of ['arm', 'takeoff', 'land', 'rtl', 'hold', 'kill', 'offboard_start'] as ActionName[]) {
      expect(unavailable(action, { ...facts, lost: false, replayed: true })).toBe('A recording takes no commands.');
    }
  });
});

/** Looks once per frame, as the page does while it is painted. */
function look(c: Confirmation, from_s: number, to_s: number): Confirmation['phase'] {
  for (let at_s = from_s; at_s < to_s; at_s += 1 / 50) c.tick(at_s);
  return c.tick(to_s);
}

describe('confirmation', () => {
  it('expires after five seconds untouched', () => {
    const c = new Confirmation(false, 100);
    expect(c.tick(100 + EXPIRES_AFTER_S - 0.01)).toBe('asking');
    expect(c.tick(100 + EXPIRES_AFTER_S)).toBe('expired');
  });
  it('needs the key held to its end, longer for what is dangerous', () => {
    const c = new Confirmation(false, 0);
    c.press(1);
    c.press(1.5); // the keyboard repeats
    expect(look(c, 1, 1 + HOLD_S - 0.01)).toBe('asking');
    expect(look(c, 1 + HOLD_S - 0.01, 1 + HOLD_S)).toBe('confirmed');
    const kill = new Confirmation(true, 0);
    kill.press(0);
    expect(look(kill, 0, HOLD_S)).toBe('asking');
    expect(look(kill, HOLD_S, HOLD_DANGER_S)).toBe('confirmed');
  });
  it('starts over when let go early, and does not expire under the finger', () => {
    const c = new Confirmation(true, 0);
    c.press(4.5);
    expect(look(c, 4.5, 5.5)).toBe('asking');
    c.release(5.6);
    expect(c.progress()).toBe(0);
    expect(c.tick(5.6 + EXPIRES_AFTER_S)).toBe('expired');
    const dropped = new Confirmation(false, 0);
    dropped.press(0);
    dropped.release(10);
    expect(dropped.tick(10.1)).toBe('asking');
  });
  it('does not take a page that stood still for a key that was held', () => {
    const kill = new Confirmation(true, 0);
    kill.press(0);
    expect(kill.tick(0.02)).toBe('asking');
    expect(kill.tick(4)).toBe('asking'); // four seconds without a frame: the key may have been let go after a tenth
    kill.release(4.01);
    expect(look(kill, 4.02, 6)).toBe('asking');
  });
  it('is done by the arrow keys step by step, each a press, and goes back when the knob loses the keyboard', () => {
    const c = new Confirmation(true, 0);
    for (let i = 1; i < KNOB_STEPS; i++) c.step(1, i * 0.2);
    expect([c.tick(2), c.progress()]).toEqual(['asking', 0.9]);
    c.step(-1, 2);
    expect(c.progress()).toBe(0.8);
    c.release(2.1);
    expect(c.progress()).toBe(0);
    for (let i = 0; i < 3; i++) c.step(1, 3);
    c.step(-Infinity, 3);
    expect(c.progress()).toBe(0);
    for (let i = 0; i < KNOB_STEPS; i++) c.step(1, 4);
    expect(c.tick(4)).toBe('confirmed');
    const expires = new Confirmation(true, 0);
    expires.step(1, 1);
    expect(expires.tick(1 + EXPIRES_AFTER_S)).toBe('expired');
  });
  it('is done only by the whole way of the knob', () => {
    const c = new Confirmation(false, 0);
    c.slide(0.98, 1);
    c.letGo(1.1);
    expect(c.tick(1.2)).toBe('asking');
    expect(c.progress()).toBe(0);
    c.slide(1.2, 2);
    expect(c.tick(2)).toBe('confirmed');
    c.cancel();
    expect(c.phase).toBe('confirmed');
  });
});

describe('offboard', () => {
  const raw = {
    streaming: true,
    state: 'streaming',
    client: 'page-1',
    rate_hz: 50,
    rate_achieved_hz: 49.9,
    age_s: 0.1,
    valid_for_s: 10,
    valid_left_s: 8.2,
    setpoint: { type: 'position', position_ned_m: [1, 2, -3], yaw_ned_rad: 0.5 },
    on_expiry: { action: 'hold', hold_for_s: 5 },
    if_stream_stops: 'it lands',
    sends_failed: 0,
    ended: null,
  };
  it('tells of limits that a restart kept or lost, and of no others', () => {
    const origin = {
      active: true,
      restored: false,
      set_by: 'anna',
      set_unix_s: 1,
      kept: true,
      recognised_by: 'uid' as const,
      warning: null,
      text: 'Limits of anna.',
    };
    expect(limitsNotice(readOffboard({ ...raw, limits_origin: origin })?.limitsOrigin)).toBeNull();
    expect(limitsNotice({ ...origin, restored: true })).toEqual({ text: 'Limits of anna.', caution: false });
    expect(limitsNotice({ ...origin, warning: 'Not in force: the file cannot be read.' })).toEqual({
      text: 'Not in force: the file cannot be read.',
      caution: true,
    });
    expect(limitsNotice(readOffboard(raw)?.limitsOrigin)).toBeNull();
  });
  it('reads the server’s stream and how far the vehicle is off', () => {
    const stream = readOffboard(raw);
    expect(stream).toMatchObject({
      streaming: true,
      type: 'position',
      rate_hz: 49.9,
      validLeft_s: 8.2,
      onExpiry: 'holds 5 s, then Hold mode',
      ifStreamStops: 'it lands',
    });
    expect(stream && error_m(stream, [1, 2, 1])).toBe(4);
    expect(stream && error_m(stream, null)).toBeNull();
    expect(readOffboard({ streaming: false, state: 'idle', setpoint: null })).toMatchObject({ streaming: false, type: null, rate_hz: null });
    expect(readOffboard(null)).toBeNull();
  });
  it('nudges from what is streamed: up is negative down, yaw wraps', () => {
    const stream = readOffboard(raw);
    const from = stream && nudgeBase(stream, [9, 9, 9], 3);
    expect(from).toEqual({ type: 'position', position_ned_m: [1, 2, -3], yaw_ned_rad: 0.5 });
    const [, one, five] = STEPS;
    if (!from || !one || !five) throw new Error('no steps');
    expect(nudge(from, 'up', 1, one).position_ned_m).toEqual([1, 2, -4]);
    expect(nudge(from, 'north', -1, five).position_ned_m).toEqual([-4, 2, -3]);
    expect(nudge({ ...from, yaw_ned_rad: 3 }, 'yaw', 1, five).yaw_ned_rad).toBeCloseTo(3 + Math.PI / 4 - 2 * Math.PI);
  });
  it('says a setpoint again in time, and stops when the stream or the server says no', async () => {
    const said: unknown[] = [];
    let answer: Said = 'taken';
    const keeper = new SetpointKeeper((s) => {
      said.push(s);
      return Promise.resolve(answer);
    });
    const setpoint: PositionSetpoint = { type: 'position', position_ned_m: [0, 0, -5], yaw_ned_rad: 0 };
    keeper.keep({ ...setpoint }, LASTING, 0);
    keeper.tick(2.9, true);
    expect(said).toHaveLength(0);
    keeper.tick(3, true);
    keeper.tick(3.1, true);
    expect(said).toHaveLength(1);
    await Promise.resolve();
    answer = 'refused';
    keeper.tick(6.1, true);
    await Promise.resolve();
    expect(keeper.setpoint).toBeNull();
    keeper.keep({ ...setpoint }, LASTING, 10);
    keeper.tick(14, false);
    expect(keeper.setpoint).toBeNull();
    keeper.keep({ ...setpoint }, { ...LASTING, renew: false }, 20);
    keeper.tick(24, true);
    expect(keeper.setpoint).toBeNull();
    expect(said).toHaveLength(2);
  });
  it('tries again what did not get through, until it has expired', async () => {
    const said: number[] = [];
    let answer: Said = 'not now';
    const keeper = new SetpointKeeper((): Promise<Said> => {
      said.push(now_s);
      return Promise.resolve(answer);
    });
    let now_s = 0;
    keeper.keep({ type: 'position', position_ned_m: [0, 0, -5], yaw_ned_rad: 0 }, LASTING, now_s);
    const until = async (end_s: number): Promise<void> => {
      for (; now_s < end_s; now_s += 1) {
        keeper.tick(now_s, true);
        await Promise.resolve();
      }
    };
    await until(5);
    answer = 'taken';
    await until(7);
    answer = 'not now';
    await until(60);
    expect(said).toEqual([3, 6, 9, 12, 15]); // taken at 6, good for 10 s
    expect(keeper.setpoint).toBeNull();
  });
  it('goes on saying what is flown where something new is refused, and nothing where no answer came', async () => {
    const said: unknown[] = [];
    let answer: () => Response = () => Response.json({});
    const api = new ApiClient('me', undefined, (_, init) => {
      said.push((JSON.parse(init.body as string) as { position_ned_m: unknown }).position_ned_m);
      return Promise.resolve().then(answer);
    });
    let now_s = 0;
    const control = new OffboardControl(api, new Turns(), () => now_s);
    const settle = async (): Promise<void> => void (await new Promise((done) => setTimeout(done, 0)));
    const at = (north_m: number): PositionSetpoint & Record<string, unknown> => ({ type: 'position', position_ned_m: [north_m, 0, -5], yaw_ned_rad: 0 });
    await control.send('1', at(1), LASTING);
    answer = () => Response.json({ detail: 'no fresh position' }, { status: 409 });
    now_s = 2;
    await control.send('1', at(2), LASTING);
    answer = () => Response.json({});
    now_s = 3.1;
    control.tick(() => true);
    await settle();
    expect(said).toEqual([
      [1, 0, -5],
      [2, 0, -5],
      [1, 0, -5],
    ]);
    answer = () => {
      throw new TypeError('network');
    };
    await control.send('1', at(3), LASTING);
    answer = () => Response.json({});
    now_s = 20;
    control.tick(() => true);
    await settle();
    expect(said).toHaveLength(4);
  });
  it('tells that a setpoint may not be said again, once', async () => {
    let answer = (): Response => Response.json({});
    const api = new ApiClient('test', undefined, () => Promise.resolve().then(answer));
    let now_s = 0;
    const control = new OffboardControl(api, new Turns(), () => now_s);
    const told: string[] = [];
    control.onNotRenewed = (id, problem) => told.push(`${id}: ${problem.detail}`);
    const settle = async (): Promise<void> => void (await new Promise((done) => setTimeout(done, 0)));
    await control.send('1', { type: 'position', position_ned_m: [1, 0, -5], yaw_ned_rad: 0 }, LASTING);
    answer = () => Response.json({ detail: 'somebody else has control', code: 'not_in_control' }, { status: 409 });
    for (now_s of [4, 8, 12]) {
      control.tick(() => true);
      await settle();
    }
    expect(told).toEqual(['1: somebody else has control']);
  });
});

describe('gimbal', () => {
  const l = limits(null);
  it('pad and angles are inverse inside the limits', () => {
    const back = toAngles(toPoint({ pitch_deg: -32, yaw_deg: 34 }, l), l);
    expect(back.pitch_deg).toBeCloseTo(-32);
    expect(back.yaw_deg).toBeCloseTo(34);
    expect(clamp({ pitch_deg: -150, yaw_deg: 0 }, l).pitch_deg).toBe(-90);
    expect(toAngles({ x: -50, y: 999 }, l)).toEqual({ pitch_deg: -90, yaw_deg: -180 });
  });
  it('is turned by keys inside the limits, and said in words that do not tick', () => {
    const l = limits(null);
    const from = { pitch_deg: -10, yaw_deg: 178 };
    expect(stepped(from, 'ArrowUp', false, l)).toEqual({ pitch_deg: -9, yaw_deg: 178 });
    expect(stepped(from, 'ArrowRight', true, l)).toEqual({ pitch_deg: -10, yaw_deg: l.yawMax_deg });
    expect(stepped(from, 'PageDown', false, l)).toEqual({ pitch_deg: -20, yaw_deg: 178 });
    expect(stepped(from, 'Home', false, l)).toEqual({ pitch_deg: 0, yaw_deg: 0 });
    expect(stepped(from, 'End', false, l)).toEqual({ pitch_deg: l.pitchMin_deg, yaw_deg: 0 });
    for (const key of [' ', 'Enter', 'h', 'Tab']) expect(stepped(from, key, false, l)).toBeNull();
    expect(angleWords({ pitch_deg: -12.4, yaw_deg: 3.3 })).toBe('12° down, 3° right');
  });
  it('says who steers', () => {
    expect(owner(null, false).who).toBe('nobody');
    expect(owner([255, 190], true).text).toBe('this station');
    expect(owner([1, 1], false).who).toBe('vehicle');
    expect(owner([254, 191], false).text).toContain('254');
  });
  it('sends one at a time and never loses the last: the stop', async () => {
    const sent: number[] = [];
    const free: (() => void)[] = [];
    const sender = new LatestSender<number>((v) => {
      sent.push(v);
      return new Promise<void>((resolve) => free.push(resolve));
    });
    for (const v of [1, 2, 3, 0]) sender.push(v);
    expect(sent).toEqual([1]);
    free.shift()?.();
    await new Promise((r) => setTimeout(r));
    expect(sent).toEqual([1, 0]);
  });
});

describe('instruments, messages, indicators', () => {
  it('tilts the horizon against the roll', () => {
    expect(horizonTransform(Math.PI / 18, 0, 62, 62)).toBe('rotate(-10.00 62 62) translate(0 0.00)');
  });
  it('names the marks of the tape through north', () => {
    const named = tapeTicks(350, 196, 1.5)
      .filter((t) => t.label !== '')
      .map((t) => t.label);
    expect(named).toEqual(['NW', 'N', 'NE'].filter((n) => named.includes(n)));
    expect(named).toContain('N');
  });
  it('gives what matters a word, and leaves debug out', () => {
    expect(severityWord(2)).toMatchObject({ word: 'Critical', tone: 'danger' });
    expect(severityWord(6).word).toBe('');
    const line = (severity: number) => ({ key: `${severity}`, unix_s: 0, severity, kind: 'event', text: 'x' });
    expect(shown([line(7), line(6), line(4)], 1).map((m) => m.severity)).toEqual([6]);
  });
  it('shows severity with a word, and unknown as unknown', () => {
    const reading = (remaining_percent: number | null) => ({
      value: {
        remaining_percent,
        voltage_v: null,
        current_a: null,
        consumed_mah: null,
        time_remaining_s: null,
        cell_voltages_v: null,
        battery_id: 0,
        batteries: [],
      },
      age_s: 0,
      stale: false,
    });
    expect(batteryIndicator(reading(9))).toMatchObject({ severity: 'danger', word: 'empty', text: '9 %' });
    expect(batteryIndicator(reading(null)).text).toBe('–');
    expect(batteryIndicator(null).text).toBe('–');
    expect(gpsIndicator({ value: { fix_type: 1, satellites: 3, hdop: null, horizontal_accuracy_m: null }, age_s: 0, stale: false })).toMatchObject({
      text: '3 · no fix',
      severity: 'danger',
    });
  });
  it('says that a recording stopped, and does not claim one that nobody told of', () => {
    const link: LinkLine = {
      name: 'a',
      url: 'udpin://x',
      state: 'open',
      detail: '',
      replay: false,
      forward: false,
      peers: [],
      bytes_received: 5,
      bytes_sent: 0,
      bytes_dropped: 0,
      recording: { file: 'a.tlog', bytes: 2_000_000, started_unix_s: 1000, stopped: null },
      frames_received: 3,
      frames_unknown: 0,
      frames_lost: 0,
      crc_errors: 0,
      bytes_skipped: 0,
      handler_errors: 0,
      frames_sent: 0,
      frames_waiting: 0,
      frames_replaced: 0,
      frames_expired: 0,
      frames_dropped: 0,
      frames_refused: 0,
      frames_unverified: 0,
      signing: null,
    };
    const recorded = (change: object): LinkLine => ({ ...link, recording: { file: 'a.tlog', bytes: 0, started_unix_s: 1000, stopped: null, ...change } });
    expect(recordingIndicator([], false, 1221).text).toBe('–');
    expect(recordingIndicator([link], true, 1221)).toMatchObject({ text: '03:41', severity: 'none' });
    expect(recordingIndicator([link], true, 1221).details[0]?.[1]).toContain('a.tlog · 2.0 MB');
    expect(recordingIndicator([recorded({ file: null, started_unix_s: null })], true, 1221).text).toBe('Waiting');
    expect(recordingIndicator([{ ...link, replay: true, recording: null }], true, 1221).text).toBe('None');
    expect(recordingIndicator([{ ...link, recording: null }], true, 1221)).toMatchObject({ text: 'Off', severity: 'caution' });
    const stopped = recordingIndicator([link, recorded({ stopped: 'disk full' })], true, 1221);
    expect(stopped).toMatchObject({ text: 'Stopped', severity: 'danger' });
    expect(stopped.details[1]?.[1]).toBe('disk full');
    const two = linkDetails(
      [
        { ...link, frames_received: 98, frames_lost: 2, crc_errors: 1 },
        { ...link, name: 'b', state: 'waiting', detail: 'port taken' },
      ],
      null,
    ).details;
    expect(two.filter(([name]) => name === '').map(([, value]) => value)).toEqual(['a', 'b']);
    expect(two).toContainEqual(['Frames', '98 in, 2 lost (2.0 %)']);
    expect(two).toContainEqual(['CRC errors', '1']);
    expect(two.some(([, value]) => value.includes('port taken'))).toBe(true);
    expect(two.some(([name]) => name === 'Signing')).toBe(false);
    const signing = { key: 'field', mode: 'required', link_id: 0, unsigned: 2, wrong_signature: 1, replayed: 0, too_old: 0, too_many_streams: 0 };
    const signed = linkDetails(
      [
        { ...link, signing, frames_refused: 3 },
        { ...link, frames_unverified: 4 },
      ],
      null,
    ).details;
    expect(signed).toContainEqual(['Signing', 'key field, required; 3 frames refused']);
    expect(signed).toContainEqual(['Not verified', '4 signed frames (this link has no key)']);
    expect(linkDetails([link], 12_340).text).toBe('12.3 kB/s');
  });
});
