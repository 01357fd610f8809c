import { describe, expect, it } from 'vitest';
import { newItem } from './items';
import { EMPTY_PLAN, type Item, type Plan } from './document';
import { pasteItems, reverseRows, shiftAltitudes } from './edit';
import { parseCoordinates } from './coordinates';

describe('pasted coordinates', () => {
  it.each([
    ['47.39, 8.54', 47.39, 8.54],
    ['47.39,8.54', 47.39, 8.54],
    [' 47.39 8.54\n', 47.39, 8.54],
    ['(−47.39; +8.54)', -47.39, 8.54],
    ['47,39; 8,54', 47.39, 8.54],
    ['47,39 8,54', 47.39, 8.54],
    ['47.39° N, 8.54° W', 47.39, -8.54],
    ['S47.39 E8.54', -47.39, 8.54],
  ])('%j are a position', (text, lat_deg, lon_deg) => expect(parseCoordinates(text)).toEqual({ position: { lat_deg, lon_deg } }));

  it.each(['', 'hello', '47.39', '47.39, 8.54, 30', 'Infinity, 8', '47..1, 8', '1e400, 8'])('%j are none', (text) => expect(parseCoordinates(text)).toBeNull());

  it.each([
    ['97.39, 8.54', 'latitude'],
    ['47.39, 188.54', 'longitude'],
  ])('%j are off the earth, with a word about it', (text, word) => {
    expect(parseCoordinates(text)).toEqual({ problem: expect.stringContaining(word) as string });
  });
});

describe('the selected items', () => {
  const at = (lat_deg: number): Item => newItem('waypoint', { lat_deg, lon_deg: 8 }, { value_m: 30, reference: 'home' });
  const plan: Plan = {
    ...EMPTY_PLAN,
    items: [
      newItem('takeoff', { lat_deg: 47, lon_deg: 8 }, { value_m: 30, reference: 'home' }),
      at(1),
      at(2),
      at(3),
      newItem('land', { lat_deg: 47, lon_deg: 8 }, { value_m: 30, reference: 'home' }),
    ],
  };
  const lats = (changed: Plan): unknown[] => changed.items.map(({ lat_deg }) => lat_deg);
  const jump: Item = { ...newItem('jump', null, { value_m: 0, reference: 'home' }), target_index: 3, repeat: 1 };

  it('are pasted after the selection, and jumps keep their targets', () => {
    const pasted = pasteItems({ ...plan, items: [...plan.items, jump] }, ['item:2'], plan.items.slice(1, 3));
    expect(lats(pasted.plan).slice(0, 7)).toEqual([47, 1, 2, 1, 2, 3, 47]);
    expect(pasted.rows).toEqual([3, 4]);
    expect(pasted.plan.items.at(-1)?.['target_index']).toBe(5);
  });

  it('are flown in the opposite order', () => {
    expect(lats(reverseRows(plan, [1, 2, 3]))).toEqual([47, 3, 2, 1, 47]);
    expect(lats(reverseRows(plan, [1, 3]))).toEqual([47, 3, 2, 1, 47]);
  });

  it('are raised together, but a landing and a position of the camera stay', () => {
    const roi = newItem('roi_location', { lat_deg: 47, lon_deg: 8 }, { value_m: 0, reference: 'home' });
    const raised = shiftAltitudes({ ...plan, items: [...plan.items, roi] }, [0, 1, 4, 5], 12.5);
    expect(raised.items.map(({ altitude }) => altitude?.value_m)).toEqual([42.5, 42.5, 30, 30, 0, 0]);
  });
});
