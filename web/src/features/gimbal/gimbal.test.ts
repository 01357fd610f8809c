import { describe, expect, it } from 'vitest';
import { LatestSender } from './control.svelte';
import { controlHolder } from './pad';
import { gimbalKey, gimbalsOf, angleLimits, gimbalParams, withGimbal } from '../../vehicle/gimbal';
import type { VehicleFacts } from '../../vehicle/facts';
import type { Gimbal } from '../../live/topics';
import { angleText, cameraDirection, cameraYaw_deg, clamp, anglesAfterKey, toAngles, toPoint } from './pad';

describe('gimbal', () => {
  const limits = angleLimits(null);
  it('converts between points on the pad and angles, within the limits', () => {
    const angles = toAngles(toPoint({ pitch_deg: -32, yaw_deg: 34 }, limits), limits);
    expect(angles.pitch_deg).toBeCloseTo(-32);
    expect(angles.yaw_deg).toBeCloseTo(34);
    expect(clamp({ pitch_deg: -150, yaw_deg: 0 }, limits).pitch_deg).toBe(-90);
    expect(toAngles({ x: -50, y: 999 }, limits)).toEqual({ pitch_deg: -90, yaw_deg: -180 });
  });
  it('turns by keys within the limits, and gives a text in whole degrees for screen readers', () => {
    const start = { pitch_deg: -10, yaw_deg: 178 };
    expect(anglesAfterKey(start, 'ArrowUp', false, limits)).toEqual({ pitch_deg: -9, yaw_deg: 178 });
    expect(anglesAfterKey(start, 'ArrowRight', true, limits)).toEqual({ pitch_deg: -10, yaw_deg: limits.yawMax_deg });
    expect(anglesAfterKey(start, 'PageDown', false, limits)).toEqual({ pitch_deg: -20, yaw_deg: 178 });
    expect(anglesAfterKey(start, 'Home', false, limits)).toEqual({ pitch_deg: 0, yaw_deg: 0 });
    expect(anglesAfterKey(start, 'End', false, limits)).toEqual({ pitch_deg: limits.pitchMin_deg, yaw_deg: 0 });
    for (const key of [' ', 'Enter', 'h', 'Tab']) expect(anglesAfterKey(start, key, false, limits)).toBeNull();
    expect(angleText({ pitch_deg: -12.4, yaw_deg: 3.3 })).toBe('12° down, 3° right');
  });
  it('shows who controls the gimbal', () => {
    expect(controlHolder(null, false).kind).toBe('nobody');
    expect(controlHolder([255, 190], true).text).toBe('controlled by this server');
    expect(controlHolder([1, 1], false).kind).toBe('vehicle');
    expect(controlHolder([254, 191], false).text).toContain('254');
  });
  it('sends one request at a time, and always the last request, for example the stop', async () => {
    const sent: number[] = [];
    const finishRequests: (() => void)[] = [];
    const sender = new LatestSender<number>((v) => {
      sent.push(v);
      return new Promise<void>((resolve) => finishRequests.push(resolve));
    });
    for (const v of [1, 2, 3, 0]) sender.push(v);
    expect(sent).toEqual([1]);
    finishRequests.shift()?.();
    await new Promise((r) => setTimeout(r));
    expect(sent).toEqual([1, 0]);
  });
  it('can be selected by its key, and requests contain its ids', () => {
    const firstGimbal = { component_id: 1, gimbal_device_id: 1, pitch_rad: 0 } as Gimbal;
    const secondGimbal = { ...firstGimbal, component_id: 171, gimbal_device_id: 0, pitch_rad: -1 };
    const facts = (gimbals: Gimbal[]): VehicleFacts => ({ id: '7', gimbal: { value: { ...firstGimbal, gimbals } } }) as unknown as VehicleFacts;
    expect(gimbalsOf(facts([]))).toEqual([]);
    expect(gimbalParams(facts([]))).toEqual({ params: { path: { v: '7' } } });
    const twoGimbals = facts([firstGimbal, secondGimbal] as Gimbal[]);
    expect(gimbalsOf(twoGimbals).map(gimbalKey)).toEqual(['7/1.1', '7/171.0']);
    const selected = withGimbal(twoGimbals, '7/171.0');
    expect(selected.gimbal?.value.pitch_rad).toBe(-1);
    expect(gimbalParams(selected)).toEqual({ params: { path: { v: '7' }, query: { component: 171 } } });
    expect(gimbalParams(withGimbal(twoGimbals, 'gone'))).toEqual({ params: { path: { v: '7' }, query: { component: 1, device: 1 } } });
  });
});

it('gives no yaw of the camera while the yaw is not known, although the pad shows the camera ahead', () => {
  const gimbal = { pitch_rad: -Math.PI / 4, yaw_frd_rad: null, yaw_ned_rad: Math.PI / 2 } as Gimbal;
  expect(cameraYaw_deg(gimbal, null)).toBeNull();
  expect(cameraDirection(gimbal, null)).toEqual({ pitch_deg: -45, yaw_deg: 0 });
  expect(cameraYaw_deg(gimbal, Math.PI / 4)).toBeCloseTo(45);
});
