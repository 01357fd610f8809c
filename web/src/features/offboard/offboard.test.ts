import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../api/client';
import { Turns } from '../../api/turns';
import { OffboardControl } from './control.svelte';
import { SetpointRenewer, type Said } from './renewer';
import { LASTING, nudge, STEPS, type PositionSetpoint } from '../../vehicle/setpoint';
import { error_m, limitsNotice, nudgeBase, readOffboard } from '../../vehicle/offboard';

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
  it('knows of obstacle avoidance what the server says, and nothing where an older one says nothing', () => {
    const avoidance = { on: true, way: 'over', state: 'stopped', text: 'No way.', sensor: true };
    expect(readOffboard({ ...raw, avoidance })?.avoidance).toEqual({ on: true, sensor: true, state: 'stopped', text: 'No way.' });
    expect(readOffboard(raw)?.avoidance).toEqual({ on: false, sensor: false, state: null, text: '' });
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
    const renewer = new SetpointRenewer((s) => {
      said.push(s);
      return Promise.resolve(answer);
    });
    const setpoint: PositionSetpoint = { type: 'position', position_ned_m: [0, 0, -5], yaw_ned_rad: 0 };
    renewer.keep({ ...setpoint }, LASTING, 0);
    renewer.tick(2.9, true);
    expect(said).toHaveLength(0);
    renewer.tick(3, true);
    renewer.tick(3.1, true);
    expect(said).toHaveLength(1);
    await Promise.resolve();
    answer = 'refused';
    renewer.tick(6.1, true);
    await Promise.resolve();
    expect(renewer.setpoint).toBeNull();
    renewer.keep({ ...setpoint }, LASTING, 10);
    renewer.tick(14, false);
    expect(renewer.setpoint).toBeNull();
    renewer.keep({ ...setpoint }, { ...LASTING, renew: false }, 20);
    renewer.tick(24, true);
    expect(renewer.setpoint).toBeNull();
    expect(said).toHaveLength(2);
  });
  it('tries again what did not get through, until it has expired', async () => {
    const said: number[] = [];
    let answer: Said = 'not now';
    const renewer = new SetpointRenewer((): Promise<Said> => {
      said.push(now_s);
      return Promise.resolve(answer);
    });
    let now_s = 0;
    renewer.keep({ type: 'position', position_ned_m: [0, 0, -5], yaw_ned_rad: 0 }, LASTING, now_s);
    const until = async (end_s: number): Promise<void> => {
      for (; now_s < end_s; now_s += 1) {
        renewer.tick(now_s, true);
        await Promise.resolve();
      }
    };
    await until(5);
    answer = 'taken';
    await until(7);
    answer = 'not now';
    await until(60);
    expect(said).toEqual([3, 6, 9, 12, 15]); // taken at 6, good for 10 s
    expect(renewer.setpoint).toBeNull();
  });
  it('goes on saying what is flown where something new is refused, and nothing where no answer came', async () => {
    const said: unknown[] = [];
    let answer: () => Response = () => Response.json({});
    const api = new ApiClient('me', undefined, (_, init) => {
      said.push((JSON.parse(init.body as string) as { setpoint: PositionSetpoint }).setpoint.position_ned_m);
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
