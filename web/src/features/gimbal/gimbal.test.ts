import { describe, expect, it } from 'vitest';
import { LatestSender } from './latest';
import { owner } from './owner';
import { limits } from '../../vehicle/gimbal';
import { angleWords, clamp, stepped, toAngles, toPoint } from './pad';

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
    expect(owner([255, 190], true).text).toBe('this server');
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
