import { beforeEach, describe, expect, it } from 'vitest';
import type { ApiClient } from '../../api/client';
import { ActionController } from '../../app/actions/controller.svelte';
import type { Component } from '../../live/topics';
import type { VehicleFacts } from '../../vehicle/facts';
import { CameraControl, reasonNoPhoto } from './control.svelte';

const component = (kind: string, component_id: number, lost = false): Component => ({ kind, component_id, lost }) as unknown as Component;
const vehicle = (...components: Component[]): VehicleFacts => ({ id: '7', name: '7', lost: false, replayed: false, components }) as unknown as VehicleFacts;

describe('the cameras of a vehicle', () => {
  let calls: unknown[] = [];
  let accepted = true;
  let control: CameraControl;
  const firstCamera = component('camera', 100);
  const secondCamera = component('camera', 102);
  const facts = vehicle(component('autopilot', 1), firstCamera, secondCamera);

  beforeEach(() => {
    calls = [];
    accepted = true;
    const post = async (path: string, request: unknown): Promise<unknown> => {
      calls.push([path, request]);
      return accepted ? { ok: true, value: null } : { ok: false, problem: { code: 'rejected' } };
    };
    const api = { post } as unknown as ApiClient;
    control = new CameraControl(
      api,
      new ActionController(
        api,
        () => 0,
        () => Promise.reject(new Error('not requested')),
        () => facts,
      ),
    );
  });

  it('have a default selection: the first connected camera', () => {
    expect(control.selectedCamera(vehicle(component('autopilot', 1)))).toBeNull();
    expect(control.selectedCamera(facts)).toBe(firstCamera);
    expect(control.selectedCamera(vehicle(component('camera', 100, true), secondCamera))).toBe(secondCamera);
    control.select(facts, 102);
    expect(control.selectedCamera(facts)).toBe(secondCamera);
  });
  it('take photos one at a time, and each request names the camera’s component', async () => {
    await Promise.all([control.takePhoto(facts, secondCamera), control.takePhoto(facts, secondCamera)]);
    expect(calls).toEqual([['/vehicles/{v}/camera/picture', { params: { path: { v: '7' }, query: { component: 102 } } }]]);
    expect(control.hasTakenPhoto(facts, secondCamera)).toBe(true);
    expect(control.hasTakenPhoto(facts, firstCamera)).toBe(false);
  });
  it('report no photo after a refusal, and can then take the next photo', async () => {
    accepted = false;
    await control.takePhoto(facts, firstCamera);
    expect(control.hasTakenPhoto(facts, firstCamera)).toBe(false);
    accepted = true;
    await control.takePhoto(facts, firstCamera);
    expect(control.hasTakenPhoto(facts, firstCamera)).toBe(true);
  });
  it('take no photo without a connection or in a replay', async () => {
    const lostCamera = component('camera', 100, true);
    expect(reasonNoPhoto(facts, lostCamera)).toBe('No connection to the camera.');
    expect(reasonNoPhoto({ ...facts, lost: true }, firstCamera)).toBe('No connection to the vehicle.');
    expect(reasonNoPhoto({ ...facts, replayed: true }, firstCamera)).toBe('A replayed vehicle accepts no commands.');
    await control.takePhoto(facts, lostCamera);
    expect(calls).toEqual([]);
  });
});
