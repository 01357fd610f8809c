import { expect, it } from 'vitest';
import { horizonTransform, tapeTicks } from './attitude';

it('rotates the horizon by the negative roll', () => {
  expect(horizonTransform(Math.PI / 18, 0, 62, 62)).toBe('rotate(-10.00 62 62) translate(0 0.00)');
});

it('labels the marks of the heading tape on both sides of north', () => {
  const labels = tapeTicks(350, 196, 1.5)
    .filter((t) => t.label !== '')
    .map((t) => t.label);
  expect(labels).toEqual(['NW', 'N', 'NE'].filter((n) => labels.includes(n)));
  expect(labels).toContain('N');
});
