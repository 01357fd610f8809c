import { beforeEach, describe, expect, it, vi } from 'vitest';
import type { ApiClient } from '../../api/client';
import type { ActionController } from '../../app/actions/controller.svelte';
import type { VehicleFacts } from '../../vehicle/facts';
import { positionAt } from '../../vehicle/geo';
import { besideOf, deviceSetpoint } from './device';
import { DeviceFollowing } from './device.svelte';
import { NO_LIMITS, type Draft } from './guided';
import { Locator, positionOf, type DevicePosition } from './locator.svelte';

const VEHICLE = { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 510, alt_home_m: 10, heading_deg: 0 };
const DRAFT: Draft = {
  kind: 'device',
  place: null,
  texts: { alt_home_m: '12', yaw_ned_deg: '', speed_m_s: '', radius_m: '20', behind_m: '5', above_m: '2', distance_m: '15' },
  clockwise: true,
  nose: 'vehicle',
  leader: '',
  followNose: 'face',
};
const factsOf = (offboard: unknown = null): VehicleFacts =>
  ({
    id: '1',
    name: 'Quad 1',
    lost: false,
    replayed: false,
    inAir: true,
    offboard,
    status: { value: { mode: 'hold', mode_label: 'Hold' } },
    globalPosition: { value: VEHICLE, stale: false },
    home: { value: { lat_deg: 47.4, lon_deg: 8.5, alt_amsl_m: 500 } },
  }) as unknown as VehicleFacts;
const STREAMING = { streaming: true, requestedType: 'follow_device' };

let now_ms = 0;
let facts = factsOf();
let sent: { setpoint: Record<string, unknown>; valid_for_s: number }[] = [];
let isAccepted = true;
let request = vi.fn();
let locator: Locator;
let following: DeviceFollowing;
/** The device is this far south of the vehicle. */
const deviceAt = (south_m: number, more: Partial<DevicePosition> = {}): DevicePosition => ({
  ...positionAt(VEHICLE, { north_m: -south_m, east_m: 0 }),
  accuracy_m: 6,
  velocity_ne_m_s: null,
  at_ms: now_ms - 400,
  ...more,
});
async function arrive(position: DevicePosition): Promise<void> {
  locator.position = position;
  locator.onPosition(position);
  await Promise.resolve();
  await Promise.resolve();
}
function start(): void {
  locator.position = deviceAt(40);
  following.request(DRAFT, facts, NO_LIMITS);
  request.mock.calls[0]?.[4].onOutcome({ ok: true, value: null });
  facts = factsOf(STREAMING);
}

beforeEach(() => {
  [now_ms, sent, isAccepted, facts, request] = [1_000_000, [], true, factsOf(), vi.fn()];
  const api = {
    post: (_: string, { body }: { body: (typeof sent)[number] }) => {
      sent.push(body);
      return Promise.resolve(isAccepted ? { ok: true, value: null } : { ok: false, problem: { code: 'refused', status: 409 } });
    },
  };
  locator = new Locator(null);
  const actions = { request, gate: { fix: () => ({ problem: () => null }) } } as unknown as ActionController;
  following = new DeviceFollowing(
    api as unknown as ApiClient,
    actions,
    () => facts,
    locator,
    () => now_ms,
  );
});

describe('following this device', () => {
  it('says what it waits for, and why it is not possible', () => {
    const why = (): string | null => following.whyNot(DRAFT, facts, NO_LIMITS);
    expect(why()).toContain('Waiting');
    locator.position = deviceAt(40, { accuracy_m: 34.2 });
    expect(why()).toContain('accurate to 35 m');
    locator.position = deviceAt(300);
    expect(why()).toContain('300 m from the vehicle: at most 200 m');
    locator.position = deviceAt(40);
    expect(why()).toBeNull();
    expect(following.whyNot({ ...DRAFT, texts: { ...DRAFT.texts, alt_home_m: '3' } }, facts, NO_LIMITS)).toBe('From 5 to 500 m.');
    expect(following.whyNot({ ...DRAFT, texts: { ...DRAFT.texts, distance_m: '5' } }, facts, NO_LIMITS)).toContain('no less than the distance');
    locator.problem = 'not allowed';
    expect(why()).toBe('not allowed');
  });

  it('confirms distance, side and height, and starts with the newest position', () => {
    locator.position = deviceAt(40);
    expect(following.effect(DRAFT, facts)).toMatch(/40\.0 m away now, accurate to 6 m; stays 15 m north of it at 12.0 m above home.*no position comes for 4 s/);
    following.request(DRAFT, facts, NO_LIMITS);
    const streamStart = request.mock.calls[0]?.[4];
    expect(streamStart.text).toContain('stays 15 m north of it');
    expect(streamStart.validity).toMatchObject({ valid_for_s: 4, renew: false, on_expiry: { action: 'hold' } });
    now_ms += 9000;
    expect(streamStart.newest().age_s).toBeCloseTo(9.4); // which the server refuses
    locator.position = deviceAt(42);
    expect(streamStart.newest()).toMatchObject({ type: 'follow_device', age_s: expect.closeTo(0.4), alt_home_m: 12, yaw: 'face' });
    expect(following.vehicles()).toEqual([]);
  });

  it('sends each position, on the same side, until the vehicle flies something else', async () => {
    start();
    expect(following.vehicles()).toEqual(['1']);
    for (const south_m of [41, 42]) {
      now_ms += 1000;
      await arrive(deviceAt(south_m));
    }
    expect(sent).toHaveLength(2);
    expect(sent[1]?.valid_for_s).toBe(4);
    expect(sent[1]?.setpoint['offset_ne_m']).toEqual([expect.closeTo(15), expect.closeTo(0)]);
    expect(following.progress(facts)?.text).toContain('42.0 m away; its position is 0 s old');
    following.end('1');
    await arrive(deviceAt(43));
    expect(sent).toHaveLength(2);
    expect(following.progress(facts)).toMatchObject({ ended: true });
    following.forget('1');
    expect(following.progress(facts)).toBeNull();
  });

  it('ends with Hold, and is not begun again by later positions', async () => {
    start();
    facts = factsOf({ streaming: false, requestedType: null });
    now_ms += 3500;
    await arrive(deviceAt(41));
    expect(sent).toEqual([]);
    expect(following.progress(facts)).toEqual({ text: 'Following has ended: the vehicle is in Hold.', ended: true });
  });

  it('ends when no position could be used for as long as one is valid', async () => {
    start();
    isAccepted = false;
    for (let second = 0; second < 4; second += 1) {
      now_ms += 1000;
      await arrive(deviceAt(41, { accuracy_m: 50 }));
    }
    expect(sent).toHaveLength(4);
    now_ms += 1000;
    expect(following.progress(facts)).toMatchObject({ ended: true });
    isAccepted = true;
    await arrive(deviceAt(41));
    expect(sent).toHaveLength(4);
    expect(following.vehicles()).toEqual([]);
  });
});

it('keeps the side on which the vehicle is, and takes north where it is above the device', () => {
  const device = positionAt(VEHICLE, { north_m: 0, east_m: 30 });
  expect(besideOf(10, 8, 'keep', device, VEHICLE).offset_ne_m).toEqual([expect.closeTo(0), expect.closeTo(-10)]);
  expect(besideOf(10, 8, 'keep', VEHICLE, VEHICLE).offset_ne_m).toEqual([10, 0]);
  expect(deviceSetpoint(besideOf(10, 8, 'same', device, VEHICLE), deviceAt(1), now_ms)).toMatchObject({ yaw: 'keep' });
});

it('reads the velocity of a device only if it reports one', () => {
  const at = (speed: number | null, heading: number | null): DevicePosition =>
    positionOf({ coords: { latitude: 1, longitude: 2, accuracy: 3, speed, heading }, timestamp: 4 } as GeolocationPosition);
  expect(at(2, 90).velocity_ne_m_s).toEqual([expect.closeTo(0), expect.closeTo(2)]);
  for (const [speed, heading] of [
    [null, 90],
    [2, null],
    [0, NaN],
    [300, 0],
  ] as const)
    expect(at(speed, heading).velocity_ne_m_s).toBeNull();
});

it('locates only while somebody needs it, and says why it cannot', () => {
  vi.useFakeTimers();
  const asked: [(found: GeolocationPosition) => void, (error: GeolocationPositionError) => void][] = [];
  const geolocation = { getCurrentPosition: (ok: never, failed: never) => asked.push([ok, failed]) } as unknown as Geolocation;
  const used = new Locator(geolocation);
  const stop = used.use();
  expect(used.use()).not.toBe(stop);
  expect(asked).toHaveLength(1);
  asked[0]?.[1]({ code: 1 } as GeolocationPositionError);
  expect(used.problem).toContain('allow it');
  vi.advanceTimersByTime(1100);
  asked[1]?.[0]({ coords: { latitude: 1, longitude: 2, accuracy: 3, speed: null, heading: null }, timestamp: 4 } as GeolocationPosition);
  expect([used.problem, used.position?.lat_deg]).toEqual([null, 1]);
  stop();
  stop();
  vi.advanceTimersByTime(1100);
  expect(asked).toHaveLength(3); // somebody else still needs it
  vi.useRealTimers();
});
