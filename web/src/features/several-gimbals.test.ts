/** A vehicle with two gimbals: the map's menu points the gimbal that is selected on the gimbal card. */

import { beforeEach, describe, expect, it } from 'vitest';
import type { ApiClient } from '../api/client';
import { ActionController } from '../app/actions/controller.svelte';
import { provide } from '../app/services';
import type { Gimbal } from '../live/topics';
import type { VehicleFacts } from '../vehicle/facts';
import { gimbalKey, gimbalsOf } from '../vehicle/gimbal';
import { GimbalControl } from './gimbal/control.svelte';
import { MapPointMenu } from './stage/map-point.svelte';

interface Call {
  path: string;
  query: unknown;
}

const gimbalDevice = (component_id: number, gimbal_device_id: number): Gimbal =>
  ({ component_id, gimbal_device_id, pitch_rad: 0, yaw_lock: false, gimbals: [] }) as unknown as Gimbal;
const gimbals = [gimbalDevice(1, 1), gimbalDevice(171, 0)];

function vehicle(id: string): VehicleFacts {
  const position = { lat_deg: 47, lon_deg: 8, alt_amsl_m: 510, alt_home_m: 10 };
  return {
    id,
    name: id,
    lost: false,
    replayed: true,
    gimbal: { value: { ...gimbals[0], gimbals } },
    globalPosition: { value: position },
    home: { value: { ...position, alt_amsl_m: 500 } },
    attitude: { value: { yaw_ned_rad: 0 } },
  } as unknown as VehicleFacts;
}

describe('a vehicle with two gimbals', () => {
  let calls: Call[] = [];
  let gimbal: GimbalControl;
  let menu: MapPointMenu;
  const facts = vehicle('7');

  beforeEach(() => {
    calls = [];
    const respond = async (path: string, { params }: { params: { query?: unknown } }): Promise<unknown> => {
      calls.push({ path, query: params.query });
      return { ok: true, value: { in_control: true, roi: null, limited: null } };
    };
    const api = { get: respond, post: respond } as unknown as ApiClient;
    const actions = new ActionController(
      api,
      () => 0,
      () => Promise.reject(new Error('not requested')),
      () => facts,
    );
    gimbal = new GimbalControl(api, actions);
    provide('gimbal', gimbal);
    menu = new MapPointMenu(api, actions, () => 0);
  });

  it('has the first gimbal selected initially, and a selection for each vehicle', () => {
    const [first = facts, second = facts] = gimbalsOf(facts);
    expect(gimbalKey(gimbal.withSelectedGimbal(facts))).toBe(gimbalKey(first));
    gimbal.select(facts, gimbalKey(second));
    expect(gimbalKey(gimbal.withSelectedGimbal(facts))).toBe(gimbalKey(second));
    expect(gimbalKey(gimbal.withSelectedGimbal(vehicle('8')))).toBe('8/1.1');
  });

  it('has a target and a yaw lock of its own for each gimbal of each vehicle', () => {
    gimbal.point(facts, { pitch_deg: -20, yaw_deg: 0 });
    gimbal.setYawLock(facts, true);
    expect([gimbal.targetAnglesOf(facts)?.pitch_deg, gimbal.yawLock(facts)]).toEqual([-20, true]);
    expect([gimbal.targetAnglesOf(vehicle('8')), gimbal.yawLock(vehicle('8'))]).toEqual([null, false]);
  });

  it('stops the gimbal that was turned, although another vehicle’s gimbal is commanded meanwhile', async () => {
    gimbal.turn(facts, 1, 0);
    gimbal.stop();
    gimbal.point(vehicle('8'), { pitch_deg: 0, yaw_deg: 0 });
    await new Promise((resolve) => setTimeout(resolve));
    expect(calls.map(({ path }) => path.split('/').at(-1))).toEqual(['rates', 'angles', 'rates']);
  });

  it('has a menu that keeps the chosen altitude for the next point, until another vehicle is selected', () => {
    const at = { lat_deg: 47.001, lon_deg: 8, ground_amsl_m: null, scenePixel: null };
    const onGround = { ...facts, inAir: false } as VehicleFacts;
    menu.open(at, onGround);
    expect(menu.goto_home_m).toBe(10); // not 0, which would fly into the ground after the take-off
    menu.setAltitude('goto_home_m', 42);
    menu.open({ ...at, lat_deg: 47.002 }, { ...facts, inAir: true } as VehicleFacts);
    expect(menu.goto_home_m).toBe(42);
    menu.open(at, { ...vehicle('8'), inAir: false } as VehicleFacts);
    expect(menu.goto_home_m).toBe(10);
  });

  it.each([
    ['first', 0, { component: 1, device: 1 }],
    ['second', 1, { component: 171 }],
  ])('points the %s gimbal at a map point if this gimbal is selected', async (_, index, query) => {
    gimbal.select(facts, gimbalKey(gimbalsOf(facts)[index] ?? facts));
    for (const sendCommand of [() => menu.lookAt(gimbal.withSelectedGimbal(facts)), () => menu.setRoi(gimbal.withSelectedGimbal(facts))]) {
      menu.open({ lat_deg: 47.001, lon_deg: 8, ground_amsl_m: 500, scenePixel: null }, facts); // the menu closes when the server has accepted the command
      await sendCommand();
    }
    const posts = calls.filter((call) => !call.path.endsWith('/gimbal'));
    expect(posts).toEqual(['angles', 'roi'].map((command) => ({ path: `/vehicles/{v}/gimbal/${command}`, query })));
  });
});
