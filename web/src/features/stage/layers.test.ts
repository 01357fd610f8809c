import { describe, expect, it } from 'vitest';
import type { LayerEditor, LayerPoint } from '../../app/map-layers.svelte';
import { fromPixel, mercator, pixelsPerMetre, positionAt, toPixel, type GeoPosition } from '../../vehicle/geo';
import { iconName, toGeoJson } from './layer-draw';
import { clickOnGround, LayerGesture, viewFromAbove, targetAt } from './layer-gesture';

const HERE = { lat_deg: 47.4, lon_deg: 8.5 };
const unscaledMap = { centre: mercator(HERE), world_px: 1, up_rad: 0, width: 1000, height: 800 };
/** Two pixels per metre. */
const map = { ...unscaledMap, world_px: 2 / pixelsPerMetre(unscaledMap) };
const view = viewFromAbove(map);
const targetOn = (target: LayerPoint) => ({ point: target, part: 'point' as const });

const point = (id: string, east_m: number, mark: LayerPoint['mark'] = 'disc'): LayerPoint => ({
  ...positionAt(HERE, { east_m, north_m: 0 }),
  id,
  mark,
  tone: 'target',
  text: id,
  selected: false,
});

/** Records the calls of the editor. */
class RecordingEditor implements LayerEditor {
  readonly calls: unknown[] = [];
  /** @param grabbed what `grab` returns. */
  constructor(private readonly grabbed: string | null = null) {}
  pick = (id: string, more: boolean): void => void this.calls.push(['pick', id, more]);
  grab = (id: string): string | null => {
    this.calls.push(['grab', id]);
    return this.grabbed;
  };
  drag = (id: string, to: GeoPosition): void => void this.calls.push(['drag', id, to]);
  raise = (by_m: number): void => void this.calls.push(['raise', by_m]);
  drop = (keep: boolean): void => void this.calls.push(['drop', keep]);
  press = (): boolean => {
    this.calls.push(['press']);
    return true;
  };
  remove = (): boolean => false;
}

describe('the point under a pointer', () => {
  it('is the nearest point within reach', () => {
    const points = [point('a', 0), point('b', 10)];
    expect(targetAt(view, { x: 512, y: 400 }, points, 14)?.point.id).toBe('b');
    expect(targetAt(view, { x: 540, y: 400 }, points, 14)).toBeNull();
  });
  it('prefers a point of the plan to a midpoint, even if the midpoint is nearer', () => {
    const points = [point('a', 0), point('middle', 3, 'midpoint')];
    expect(targetAt(view, { x: 505, y: 400 }, points, 14)?.point.id).toBe('a');
    expect(targetAt(view, { x: 515, y: 400 }, points, 14)?.point.id).toBe('middle');
  });
});

describe('a click on the ground', () => {
  it('is used by the edited layer, but a right click changes no layer', () => {
    const editor = new RecordingEditor();
    expect([clickOnGround(HERE, true, editor), editor.calls]).toEqual(['nothing', []]);
    expect([clickOnGround(HERE, false, editor), editor.calls]).toEqual(['used', [['press']]]);
    expect([clickOnGround(HERE, false, null), clickOnGround(HERE, true, null)]).toEqual(['menu', 'menu']);
  });
});

describe('a gesture', () => {
  it('selects the point if the pointer does not move', () => {
    const editor = new RecordingEditor('a');
    const gesture = new LayerGesture(editor);
    gesture.start(view, { x: 503, y: 402 }, targetOn(point('a', 0)), true);
    gesture.move(view, { x: 505, y: 403 });
    gesture.end();
    expect(editor.calls).toEqual([['pick', 'a', true]]);
  });

  it('drags the point with a constant offset to the pointer', () => {
    const editor = new RecordingEditor('a');
    const gesture = new LayerGesture(editor);
    gesture.start(view, { x: 503, y: 402 }, targetOn(point('a', 0)), false);
    gesture.move(view, { x: 523, y: 402 });
    gesture.end();
    const [grab, drag, drop] = editor.calls as [unknown, [string, string, GeoPosition], unknown];
    expect(grab).toEqual(['grab', 'a']);
    expect(drop).toEqual(['drop', true]);
    const pixel = toPixel(map, drag[2]);
    expect(pixel.x).toBeCloseTo(520, 3);
    expect(pixel.y).toBeCloseTo(400, 3);
  });

  it('drags the inserted point if it begins on a midpoint', () => {
    const editor = new RecordingEditor('new');
    const gesture = new LayerGesture(editor);
    gesture.start(view, { x: 500, y: 400 }, targetOn(point('middle', 0, 'midpoint')), false);
    gesture.move(view, { x: 520, y: 400 });
    expect(editor.calls.at(-1)).toMatchObject(['drag', 'new', {}]);
  });

  it('moves all points back when it is cancelled', () => {
    const editor = new RecordingEditor('a');
    const gesture = new LayerGesture(editor);
    gesture.start(view, { x: 500, y: 400 }, targetOn(point('a', 0)), false);
    gesture.move(view, { x: 520, y: 400 });
    gesture.cancel();
    gesture.end();
    expect(editor.calls.at(-1)).toEqual(['drop', false]);
  });

  it('only selects a point that cannot move', () => {
    const editor = new RecordingEditor(null);
    const gesture = new LayerGesture(editor);
    gesture.start(view, { x: 500, y: 400 }, targetOn(point('a', 0)), false);
    gesture.move(view, { x: 520, y: 400 });
    gesture.move(view, { x: 540, y: 400 });
    gesture.end();
    expect(editor.calls).toEqual([
      ['grab', 'a'],
      ['pick', 'a', false],
    ]);
  });

  it('moves the point with the first key press if it was grabbed by keyboard', () => {
    const editor = new RecordingEditor('a');
    const gesture = new LayerGesture(editor);
    expect(gesture.grabByKeyboard(view, point('a', 0))).toBe(true);
    gesture.move(view, { x: 501, y: 400 });
    gesture.end();
    expect(editor.calls[1]).toEqual(['drag', 'a', fromPixel(map, { x: 501, y: 400 })]);
    expect(editor.calls[2]).toEqual(['drop', true]);
    expect(new LayerGesture(new RecordingEditor(null)).grabByKeyboard(view, point('a', 0))).toBe(false);
  });
});

describe('the MapLibre data', () => {
  it('has closed areas, lines and points', () => {
    const ring = [0, 10, 20].map((east_m) => positionAt(HERE, { east_m, north_m: east_m % 20 }));
    const features = toGeoJson([
      {
        points: [point('1', 0), { ...point('2', 10), selected: true }],
        lines: [{ positions: ring, tone: 'target', style: 'dotted' }],
        areas: [{ ring, tone: 'caution' }],
      },
    ]).features;
    expect(features.map((feature) => feature.properties?.['kind'])).toEqual(['area', 'dotted', 'point', 'point']);
    const area = features[0]?.geometry as { coordinates: number[][][] };
    expect(area.coordinates[0]).toHaveLength(4);
    expect(area.coordinates[0]?.at(-1)).toEqual(area.coordinates[0]?.[0]);
  });
  it('has different names for icons that look different', () => {
    const plainPoint = point('7', 0);
    const names = [
      plainPoint,
      { ...plainPoint, selected: true },
      { ...plainPoint, text: '8' },
      { ...plainPoint, mark: 'corner' as const },
      { ...plainPoint, tone: 'caution' as const },
    ].map(iconName);
    expect(new Set(names).size).toBe(5);
  });
});
