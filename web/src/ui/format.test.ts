import { describe, expect, it } from 'vitest';
import { distance, duration, durationText, fixed, heading, join, wrap180 } from './format';

describe('the text of a number', () => {
  it('shows unknown values as a dash, never as zero', () => {
    for (const unknown of [null, undefined, NaN, Infinity]) {
      expect(fixed(unknown, 1)).toBe('–');
      expect(distance(unknown).text).toBe('–');
      expect(heading(unknown)).toBe('–');
      expect(duration(unknown)).toBe('–');
    }
  });
  it('has the sign −, a + if `signed`, and no −0', () => {
    expect(fixed(-3.24, 1)).toBe('−3.2');
    expect(fixed(3.24, 1, true)).toBe('+3.2');
    expect(fixed(-0.04, 1, true)).toBe('0.0');
  });
  it('has fewer decimals for longer lengths', () => {
    expect(distance(12.44)).toEqual({ text: '12.4', unit: 'm' });
    expect(distance(412.4)).toEqual({ text: '412', unit: 'm' });
    expect(distance(12_400)).toEqual({ text: '12.4', unit: 'km' });
    expect(distance(99.96).text).toBe('100');
  });
  it('keeps headings in 000–359', () => {
    expect(heading(359.7)).toBe('000');
    expect(heading(-90)).toBe('270');
    expect(heading(4)).toBe('004');
  });
  it('formats minutes, then hours', () => {
    expect(duration(221.9)).toBe('03:41');
    expect(duration(3723)).toBe('1:02:03');
    expect([45, 750, 3723, null].map((s) => durationText(s))).toEqual(['45 s', '12 min 30 s', '1 h 02 min', '–']);
  });
  it('wraps angles, and joins texts without the unknown ones', () => {
    expect(wrap180(270)).toBe(-90);
    expect(wrap180(180)).toBe(-180);
    expect(join(['14', null, '0.8 m'])).toBe('14 · 0.8 m');
    expect(join([null, '–'])).toBe('–');
  });
});
