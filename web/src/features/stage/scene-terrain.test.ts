import { expect, it } from 'vitest';
import { terrainOf, type SceneWindow } from './scene-frame';
import { SceneTerrain } from './scene-terrain';

const LINES = [-100, -10, 0, 10, 100];
const grid = (up: (east: number, north: number) => number): number[] => LINES.flatMap((north) => LINES.flatMap((east) => [east, north, up(east, north)]));

it('interpolates between the vertices, and knows nothing outside', () => {
  const terrain = new SceneTerrain(grid((east, north) => 5 + 0.1 * east - 0.2 * north));
  expect(terrain.upAt(0, 0)).toBe(5);
  expect(terrain.upAt(55, -40)).toBeCloseTo(5 + 5.5 + 8);
  expect(terrain.upAt(100, 100)).toBeCloseTo(-5);
  expect(terrain.upAt(101, 0)).toBeNull();
  expect(terrain.upAt(0, -100.1)).toBeNull();
});

it('knows no height beside a vertex where the ground is unknown', () => {
  const terrain = new SceneTerrain(grid((east) => (east === 100 ? -20_000 : 3)));
  expect(terrain.upAt(5, 5)).toBe(3);
  expect(terrain.upAt(20, 5)).toBeNull();
});

it('finds the newest ground that the view draws, as one object', () => {
  const array = grid(() => 1);
  const node = {
    matrixWorld: { elements: [] },
    traverse: (visit: (node: unknown) => void) => [{}, { geometry: { attributes: { position: { array } } } }].forEach(visit),
  };
  const nodes: Record<string, unknown> = { '/world': { matrixWorld: { elements: [] } }, '/world/terrain_1/ground': null };
  const sceneWindow = { __viserMutable: { nodeRefFromName: nodes } } as unknown as SceneWindow;
  expect(terrainOf(sceneWindow)).toBeNull();
  nodes['/world/terrain_2/ground'] = node;
  const terrain = terrainOf(sceneWindow);
  expect(terrain?.upAt(0, 0)).toBe(1);
  expect(terrainOf(sceneWindow)).toBe(terrain);
});
