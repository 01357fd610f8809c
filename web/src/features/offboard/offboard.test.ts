import { describe, expect, it } from 'vitest';
import { ApiClient } from '../../api/client';
import { CommandQueue } from '../../api/command-queue';
import { OffboardControl } from './control.svelte';
import { SetpointRenewer, type RenewalResult } from './renewer';
import { DEFAULT_VALIDITY, nudge, nudgeSizes, type PositionSetpoint } from '../../vehicle/setpoint';
import { expiryText, positionError_m, limitsNotice, nudgeBase, readOffboard } from '../../vehicle/offboard';

describe('offboard', () => {
  const rawStatus = {
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
  it('has a notice about limits only if a restart of the server restored or lost them', () => {
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
    expect(limitsNotice(readOffboard({ ...rawStatus, limits_origin: origin })?.limitsOrigin)).toBeNull();
    expect(limitsNotice({ ...origin, restored: true })).toEqual({ text: 'Limits of anna.', caution: false });
    expect(limitsNotice({ ...origin, warning: 'Not in force: the file cannot be read.' })).toEqual({
      text: 'Not in force: the file cannot be read.',
      caution: true,
    });
    expect(limitsNotice(readOffboard(rawStatus)?.limitsOrigin)).toBeNull();
  });
  it('reads obstacle avoidance, and reads it as off from an older server', () => {
    const avoidance = { on: true, way: 'over', state: 'stopped', text: 'No way.', sensor: true };
    expect(readOffboard({ ...rawStatus, avoidance })?.avoidance).toEqual({ enabled: true, hasSensor: true, state: 'stopped', text: 'No way.' });
    expect(readOffboard(rawStatus)?.avoidance).toEqual({ enabled: false, hasSensor: false, state: null, text: '' });
  });
  it('reads the server’s stream, and computes the position error', () => {
    const stream = readOffboard(rawStatus);
    expect(stream).toMatchObject({
      streaming: true,
      type: 'position',
      rate_hz: 49.9,
      validLeft_s: 8.2,
      expiryEffect: 'the vehicle holds its position for 5 s, then the server selects Hold mode',
      ifStreamStops: 'it lands',
    });
    expect(stream && positionError_m(stream, [1, 2, 1])).toBe(4);
    expect(stream && positionError_m(stream, null)).toBeNull();
    expect(readOffboard({ streaming: false, state: 'idle', setpoint: null })).toMatchObject({ streaming: false, type: null, rate_hz: null });
    expect(readOffboard(null)).toBeNull();
  });
  it('states the failsafe that follows when the stream stops on timeout', () => {
    expect(expiryText({ action: 'stop_stream' })).toBe('the server stops the stream and the vehicle executes its failsafe');
    expect(expiryText({ action: 'stop_stream' }, 'after 1 s the vehicle returns.')).toBe(
      'the server stops the stream and the vehicle executes its failsafe: after 1 s the vehicle returns',
    );
  });
  it('nudges the streamed setpoint, negates up for NED, and wraps the yaw', () => {
    const stream = readOffboard(rawStatus);
    const base = stream && nudgeBase(stream, [9, 9, 9], 3);
    expect(base).toEqual({ type: 'position', position_ned_m: [1, 2, -3], yaw_ned_rad: 0.5 });
    const [, step1, step5] = nudgeSizes();
    if (!base || !step1 || !step5) throw new Error('no steps');
    expect(nudge(base, 'up', 1, step1).position_ned_m).toEqual([1, 2, -4]);
    expect(nudge(base, 'north', -1, step5).position_ned_m).toEqual([-4, 2, -3]);
    expect(nudge({ ...base, yaw_ned_rad: 3 }, 'yaw', 1, step5).yaw_ned_rad).toBeCloseTo(3 + Math.PI / 4 - 2 * Math.PI);
  });
  it('renews a setpoint in time, and stops when the stream ends or the server refuses', async () => {
    const sent: unknown[] = [];
    let result: RenewalResult = 'accepted';
    const renewer = new SetpointRenewer((s) => {
      sent.push(s);
      return Promise.resolve(result);
    });
    const setpoint: PositionSetpoint = { type: 'position', position_ned_m: [0, 0, -5], yaw_ned_rad: 0 };
    renewer.start({ ...setpoint }, DEFAULT_VALIDITY, 0);
    renewer.renewIfDue(2.9, true);
    expect(sent).toHaveLength(0);
    renewer.renewIfDue(3, true);
    renewer.renewIfDue(3.1, true);
    expect(sent).toHaveLength(1);
    await Promise.resolve();
    result = 'refused';
    renewer.renewIfDue(6.1, true);
    await Promise.resolve();
    expect(renewer.setpoint).toBeNull();
    renewer.start({ ...setpoint }, DEFAULT_VALIDITY, 10);
    renewer.renewIfDue(14, false);
    expect(renewer.setpoint).toBeNull();
    renewer.start({ ...setpoint }, { ...DEFAULT_VALIDITY, renew: false }, 20);
    renewer.renewIfDue(24, true);
    expect(renewer.setpoint).toBeNull();
    expect(sent).toHaveLength(2);
  });
  it('retries a failed renewal until the setpoint has expired', async () => {
    const sentAt_s: number[] = [];
    let result: RenewalResult = 'retry';
    const renewer = new SetpointRenewer((): Promise<RenewalResult> => {
      sentAt_s.push(now_s);
      return Promise.resolve(result);
    });
    let now_s = 0;
    renewer.start({ type: 'position', position_ned_m: [0, 0, -5], yaw_ned_rad: 0 }, DEFAULT_VALIDITY, now_s);
    const tickUntil = async (end_s: number): Promise<void> => {
      for (; now_s < end_s; now_s += 1) {
        renewer.renewIfDue(now_s, true);
        await Promise.resolve();
      }
    };
    await tickUntil(5);
    result = 'accepted';
    await tickUntil(7);
    result = 'retry';
    await tickUntil(60);
    expect(sentAt_s).toEqual([3, 6, 9, 12, 15]); // accepted at 6 s, then valid for 10 s
    expect(renewer.setpoint).toBeNull();
  });
  it('renews the previous setpoint after the server refuses a new setpoint, and renews no setpoint if the server does not answer', async () => {
    const sentPositions: unknown[] = [];
    let respond: () => Response = () => Response.json({});
    const api = new ApiClient('me', undefined, (_, init) => {
      sentPositions.push((JSON.parse(init.body as string) as { setpoint: PositionSetpoint }).setpoint.position_ned_m);
      return Promise.resolve().then(respond);
    });
    let now_s = 0;
    const control = new OffboardControl(api, new CommandQueue(), () => now_s);
    const settle = async (): Promise<void> => void (await new Promise((done) => setTimeout(done, 0)));
    const positionAt = (north_m: number): PositionSetpoint & Record<string, unknown> => ({
      type: 'position',
      position_ned_m: [north_m, 0, -5],
      yaw_ned_rad: 0,
    });
    await control.send('1', positionAt(1), DEFAULT_VALIDITY);
    respond = () => Response.json({ detail: 'no fresh position' }, { status: 409 });
    now_s = 2;
    await control.send('1', positionAt(2), DEFAULT_VALIDITY);
    respond = () => Response.json({});
    now_s = 3.1;
    control.onTelemetry(() => true);
    await settle();
    expect(sentPositions).toEqual([
      [1, 0, -5],
      [2, 0, -5],
      [1, 0, -5],
    ]);
    respond = () => {
      throw new TypeError('network');
    };
    await control.send('1', positionAt(3), DEFAULT_VALIDITY);
    respond = () => Response.json({});
    now_s = 20;
    control.onTelemetry(() => true);
    await settle();
    expect(sentPositions).toHaveLength(4);
  });
  it('reports a refused renewal once', async () => {
    let respond = (): Response => Response.json({});
    const api = new ApiClient('test', undefined, () => Promise.resolve().then(respond));
    let now_s = 0;
    const control = new OffboardControl(api, new CommandQueue(), () => now_s);
    const reported: string[] = [];
    control.onRenewalRefused = (id, problem) => reported.push(`${id}: ${problem.detail}`);
    const settle = async (): Promise<void> => void (await new Promise((done) => setTimeout(done, 0)));
    await control.send('1', { type: 'position', position_ned_m: [1, 0, -5], yaw_ned_rad: 0 }, DEFAULT_VALIDITY);
    respond = () => Response.json({ detail: 'somebody else has control', code: 'not_in_control' }, { status: 409 });
    for (now_s of [4, 8, 12]) {
      control.onTelemetry(() => true);
      await settle();
    }
    expect(reported).toEqual(['1: somebody else has control']);
  });
});
