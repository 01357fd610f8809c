import { afterEach, describe, expect, it, vi } from 'vitest';
import { docks, registry, rooms } from './registry.svelte';

afterEach(() => {
  vi.unstubAllGlobals();
  registry.closeRail();
  rooms.openId = 'fly';
});

const load = (): Promise<never> => Promise.reject(new Error('not loaded here'));
registry.addPanel({ id: 'a', order: 1, place: 'side', load, rail: { title: 'A', icon: 'folder', hint: '' } });
registry.addPanel({ id: 'b', order: 2, place: 'over', load });

registry.addRoom({ id: 'plan', title: 'Plan', icon: 'plan', hint: '', order: 1, layout: docks, load });

describe('a panel and a room', () => {
  it.each([
    [390, 844, false],
    [1024, 768, true],
    [1311, 900, false],
    [1312, 900, true],
    [1312, 667, false],
    [1920, 1080, true],
  ])('%d x %d px, together: %s', (width, height, isTogether) => {
    vi.stubGlobal('innerWidth', width);
    vi.stubGlobal('innerHeight', height);
    rooms.open('plan');
    expect(registry.toggle('a', null)).toBe(true);
    expect([registry.isOpen('a'), rooms.openId]).toEqual([true, isTogether ? 'plan' : 'fly']);
    rooms.open('plan');
    expect([registry.isOpen('a'), rooms.openId]).toEqual([isTogether, 'plan']);
    registry.toggle('b', null);
    expect([registry.isOpen('b'), rooms.openId]).toEqual([true, 'plan']);
    registry.close('b');
    rooms.open('fly');
    registry.close('a');
    expect(registry.toggle('a', null)).toBe(true);
    expect([registry.isOpen('a'), rooms.openId]).toEqual([true, 'fly']);
  });
});
