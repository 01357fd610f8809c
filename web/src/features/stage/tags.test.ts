import { describe, expect, it } from 'vitest';
import { TAG_HEIGHT_PX, tagBox, type TagBox } from './map-draw';

function boxesAt(points: readonly { x: number; y: number }[], width = 60): TagBox[] {
  const placed: TagBox[] = [];
  for (const point of points) placed.push(tagBox(point, width, placed));
  return placed;
}

describe('tags on the map', () => {
  it('are at the lower right of their symbols if nothing is there', () => {
    expect(
      boxesAt([
        { x: 100, y: 100 },
        { x: 300, y: 100 },
      ]),
    ).toEqual([
      { x: 124, y: 110, width: 60 },
      { x: 324, y: 110, width: 60 },
    ]);
  });

  it('of up to eight vehicles at one place do not cover each other', () => {
    const boxes = boxesAt(Array.from({ length: 8 }, () => ({ x: 100, y: 100 })));
    for (const [i, a] of boxes.entries())
      for (const b of boxes.slice(i + 1)) {
        const areApart = a.x + a.width <= b.x || b.x + b.width <= a.x || Math.abs(a.y - b.y) >= TAG_HEIGHT_PX;
        expect(areApart, JSON.stringify([a, b])).toBe(true);
      }
  });

  it('of more vehicles at one place stay beside them', () => {
    expect(boxesAt(Array.from({ length: 9 }, () => ({ x: 100, y: 100 }))).at(-1)).toEqual({ x: 124, y: 110, width: 60 });
  });
});
