import { afterEach, describe, expect, it, vi } from 'vitest';
import { registry, rooms } from './registry.svelte';

afterEach(() => {
  vi.unstubAllGlobals();
  registry.closeRail();
  rooms.openId = 'fly';
});

const load = (): Promise<never> => Promise.reject(new Error('not loaded here'));
registry.addPanel({ id: 'a', order: 1, place: 'side', load, rail: { title: 'A', icon: 'folder', hint: '' } });
registry.addPanel({ id: 'b', order: 2, place: 'over', load });

describe('a panel and a room', () => {
  it.each([
    [true, false],
    [false, true],
  ])('phone: %s, together: %s', (isPhone, isTogether) => {
    vi.stubGlobal('matchMedia', () => ({ matches: isPhone }));
    rooms.open('plan');
    expect(registry.toggle('a', null)).toBe(true);
    expect([registry.isOpen('a'), rooms.openId]).toEqual([true, isTogether ? 'plan' : 'fly']);
    rooms.open('plan');
    expect([registry.isOpen('a'), rooms.openId]).toEqual([isTogether, 'plan']);
    registry.toggle('b', null);
    expect([registry.isOpen('b'), rooms.openId]).toEqual([true, 'plan']);
    registry.close('b');
  });
});
