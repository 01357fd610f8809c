import { beforeEach, describe, expect, it } from 'vitest';
import type { ApiClient } from '../../api/client';
import type { ActionController } from '../../app/actions/controller.svelte';
import type { Component } from '../../live/topics';
import type { VehicleFacts } from '../../vehicle/facts';
import { CameraControl, reasonNoPhoto } from './control.svelte';

const component = (kind: string, component_id: number, lost = false): Component => ({ kind, component_id, lost }) as unknown as Component;
const vehicle = (...components: Component[]): VehicleFacts => ({ id: '7', name: '7', lost: false, replayed: false, components }) as unknown as VehicleFacts;

describe('the cameras of a vehicle', () => {
  let calls: unknown[] = [];
  let accepted = true;
  let control: CameraControl;
  const first = component('camera', 100);
  const second = component('camera', 102);
  const facts = vehicle(component('autopilot', 1), first, second);

  beforeEach(() => {
    calls = [];
    accepted = true;
    const post = async (path: string, request: unknown): Promise<unknown> => {
      calls.push([path, request]);
      return { ok: accepted };
    };
    const actions = {
      dismissRefusal: () => undefined,
      attempt: async (_commandName: string, _facts: unknown, _pagePart: string, send: () => Promise<{ ok: boolean }>) => (await send()).ok,
    } as unknown as ActionController;
    control = new CameraControl({ post } as unknown as ApiClient, actions);
  });

  it('have a default selection: the first connected camera', () => {
    expect(control.selectedCamera(vehicle(component('autopilot', 1)))).toBeNull();
    expect(control.selectedCamera(facts)).toBe(first);
    expect(control.selectedCamera(vehicle(component('camera', 100, true), second))).toBe(second);
    control.select(facts, 102);
    expect(control.selectedCamera(facts)).toBe(second);
  });
  it('take photos one at a time, and each request names the camera’s component', async () => {
    await Promise.all([control.takePhoto(facts, second), control.takePhoto(facts, second)]);
    expect(calls).toEqual([['/vehicles/{v}/camera/picture', { params: { path: { v: '7' }, query: { component: 102 } } }]]);
    expect(control.hasTakenPhoto(facts, second)).toBe(true);
    expect(control.hasTakenPhoto(facts, first)).toBe(false);
  });
  it('report no photo after a refusal, and can then take the next photo', async () => {
    accepted = false;
    await control.takePhoto(facts, first);
    expect(control.hasTakenPhoto(facts, first)).toBe(false);
    accepted = true;
    await control.takePhoto(facts, first);
    expect(control.hasTakenPhoto(facts, first)).toBe(true);
  });
  it('take no photo without a connection or in a replay', async () => {
    const lost = component('camera', 100, true);
    expect(reasonNoPhoto(facts, lost)).toBe('No connection to the camera.');
    expect(reasonNoPhoto({ ...facts, lost: true }, first)).toBe('No connection to the vehicle.');
    expect(reasonNoPhoto({ ...facts, replayed: true }, first)).toBe('A replayed vehicle accepts no commands.');
    await control.takePhoto(facts, lost);
    expect(calls).toEqual([]);
  });
});
