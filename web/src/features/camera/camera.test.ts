import { beforeEach, describe, expect, it } from 'vitest';
import type { ApiClient } from '../../api/client';
import type { ActionController } from '../../app/actions/controller.svelte';
import type { Component } from '../../live/topics';
import type { VehicleFacts } from '../../vehicle/facts';
import { CameraControl, whyNoPicture } from './control.svelte';

const component = (kind: string, component_id: number, lost = false): Component => ({ kind, component_id, lost }) as unknown as Component;
const vehicle = (...components: Component[]): VehicleFacts => ({ id: '7', name: '7', lost: false, replayed: false, components }) as unknown as VehicleFacts;

describe('the cameras of a vehicle', () => {
  let calls: unknown[] = [];
  let accepted = true;
  let control: CameraControl;
  const one = component('camera', 100);
  const other = component('camera', 102);
  const facts = vehicle(component('autopilot', 1), one, other);

  beforeEach(() => {
    calls = [];
    accepted = true;
    const post = async (path: string, request: unknown): Promise<unknown> => {
      calls.push([path, request]);
      return { ok: accepted };
    };
    const actions = {
      dismiss: () => undefined,
      attempt: async (_what: string, _facts: unknown, _place: string, send: () => Promise<{ ok: boolean }>) => (await send()).ok,
    } as unknown as ActionController;
    control = new CameraControl({ post } as unknown as ApiClient, actions);
  });

  it('begin with the first that is connected', () => {
    expect(control.selected(vehicle(component('autopilot', 1)))).toBeNull();
    expect(control.selected(facts)).toBe(one);
    expect(control.selected(vehicle(component('camera', 100, true), other))).toBe(other);
    control.select(facts, 102);
    expect(control.selected(facts)).toBe(other);
  });
  it('take pictures one at a time, each by its component', async () => {
    await Promise.all([control.takePicture(facts, other), control.takePicture(facts, other)]);
    expect(calls).toEqual([['/vehicles/{v}/camera/picture', { params: { path: { v: '7' }, query: { component: 102 } } }]]);
    expect(control.hasTaken(facts, other)).toBe(true);
    expect(control.hasTaken(facts, one)).toBe(false);
  });
  it('report no picture after a refusal, and can then take the next one', async () => {
    accepted = false;
    await control.takePicture(facts, one);
    expect(control.hasTaken(facts, one)).toBe(false);
    accepted = true;
    await control.takePicture(facts, one);
    expect(control.hasTaken(facts, one)).toBe(true);
  });
  it('take none without a connection or from a recording', async () => {
    const lost = component('camera', 100, true);
    expect(whyNoPicture(facts, lost)).toBe('No connection to the camera.');
    expect(whyNoPicture({ ...facts, lost: true }, one)).toBe('No connection to the vehicle.');
    expect(whyNoPicture({ ...facts, replayed: true }, one)).toBe('A recording takes no commands.');
    await control.takePicture(facts, lost);
    expect(calls).toEqual([]);
  });
});
