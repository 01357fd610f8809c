import { roundLengthBelow_m, roundLengthText } from '../../ui/format';
import { describe, expect, it } from 'vitest';
import type { VehicleFacts } from '../../vehicle/facts';
import { offsetFractions, freeAreaOffset, coveredAtEdges } from '../../app/covered-edges.svelte';
import {
  eastNorth,
  fromPixel,
  groundDistance_m,
  nearestWithin,
  mercator,
  pixelsPerMetre,
  positionAt,
  toPixel,
  type GeoPosition,
  type MapView,
} from '../../vehicle/geo';
import { edgeLabels, gridLines, gridStep_m, viewBox } from './grid';
import { isTargetActive } from './map-model';
import { attributionText, offlineMap, type MapFile } from './maps.svelte';
import {
  flightTime_s,
  altitudeInRange,
  lookAngles,
  menuCorner,
  directionText,
  whyNotGo,
  suggestedGoAlt_home_m,
  whyNotLook,
  whyNotRoi,
  type MapPoint,
} from './map-point';

const HERE = { lat_deg: 47.4, lon_deg: 8.5 };
const view = (px_per_m: number, more: Partial<MapView> = {}): MapView => {
  const baseView = { centre: mercator(HERE), world_px: 1, up_rad: 0, width: 1000, height: 800 };
  return { ...baseView, world_px: px_per_m / pixelsPerMetre(baseView), ...more };
};

describe('positions', () => {
  it('are measured in metres, also across the date line', () => {
    expect(eastNorth(HERE, { lat_deg: 47.401, lon_deg: 8.5 }).north_m).toBeCloseTo(111.2, 0);
    expect(groundDistance_m({ lat_deg: 0, lon_deg: 179.9995 }, { lat_deg: 0, lon_deg: -179.9995 })).toBeCloseTo(111.2, 0);
    const moved = positionAt(HERE, { east_m: 300, north_m: -40 });
    expect(eastNorth(HERE, moved).east_m).toBeCloseTo(300, 6);
    expect(eastNorth(HERE, moved).north_m).toBeCloseTo(-40, 6);
  });
  it('are projected to the screen, north up or rotated', () => {
    const east = positionAt(HERE, { east_m: 20, north_m: 0 });
    const northUp = toPixel(view(8), east);
    expect([northUp.x, northUp.y].map(Math.round)).toEqual([660, 400]);
    const rotated = toPixel(view(8, { up_rad: Math.PI / 2 }), east);
    expect([rotated.x, rotated.y].map(Math.round)).toEqual([500, 240]);
  });
  it('are the same after projection and back', () => {
    for (const up_rad of [0, 0.7, -2]) {
      const pixel = { x: 130, y: 720 };
      const projected = toPixel(view(3, { up_rad }), fromPixel(view(3, { up_rad }), pixel));
      expect(projected.x).toBeCloseTo(pixel.x, 4);
      expect(projected.y).toBeCloseTo(pixel.y, 4);
    }
  });
  it('are found by the nearest pixel within reach', () => {
    const points = [0, 4, 30].map((east_m) => ({ ...positionAt(HERE, { east_m, north_m: 0 }), east_m }));
    expect(nearestWithin((position) => toPixel(view(5), position), { x: 515, y: 400 }, points, 24)?.east_m).toBe(4);
    expect(nearestWithin((position) => toPixel(view(5), position), { x: 560, y: 400 }, points, 24)).toBeNull();
  });
  it('have a scale bar with a round length', () => {
    expect([110 / 4, 110 / 0.1, 110 / 60].map(roundLengthBelow_m)).toEqual([20, 1000, 1]);
    expect([roundLengthText(20), roundLengthText(2000), roundLengthText(0.5)]).toEqual(['20 m', '2 km', '0.5 m']);
  });
});

describe('grid', () => {
  it('has cells with a side of a power of ten metres, large enough to be visible', () => {
    expect([60, 8, 1, 0.1, 0.002].map(gridStep_m)).toEqual([1, 10, 100, 1000, 100_000]);
    for (let px_per_m = 30; px_per_m > 0.001; px_per_m /= 1.3) {
      const cell = gridStep_m(px_per_m) * px_per_m;
      expect(cell).toBeGreaterThanOrEqual(33.9);
      expect(cell).toBeLessThan(341);
    }
  });
  it('starts at home, with every tenth line strong', () => {
    const { thinLines, strongLines } = gridLines(HERE, { west_m: -55, east_m: 105, south_m: -5, north_m: 5 }, 10);
    expect(thinLines).toHaveLength(14); // 16 meridians from −50 to 100, without 0 and 100
    expect(strongLines).toHaveLength(3); // the meridians at 0 and 100, and the parallel through home
    expect(strongLines.some(({ from, to }) => from.lon_deg === to.lon_deg && Math.abs(from.lon_deg - HERE.lon_deg) < 1e-12)).toBe(true);
  });
  it('covers a rotated view, and is empty where a flat grid is inaccurate', () => {
    const box = viewBox(view(4, { up_rad: Math.PI / 4 }), HERE);
    expect(box.east_m).toBeCloseTo((1000 + 800) / 2 / Math.SQRT2 / 4, 0);
    expect(gridLines(HERE, { west_m: 6e5, east_m: 7e5, south_m: 0, north_m: 1e5 }, 1000)).toEqual({ thinLines: [], strongLines: [] });
  });
  it('labels the distance from the reference at its edges, only with north up', () => {
    const home = { ...HERE, name: 'home' as const };
    const labels = edgeLabels(view(1), home).map((l) => l.text);
    expect(labels).toContain('home');
    expect(labels).toContain('100 m E');
    expect(labels).toContain('300 m S');
    expect(edgeLabels(view(1, { up_rad: 0.4 }), home)).toEqual([]);
    expect(edgeLabels(view(1), { ...HERE, name: 'vehicle' }).map((l) => l.text)).toContain('vehicle');
  });
});

const reading = <T>(value: T, stale = false) => ({ value, age_s: stale ? 9 : 0, stale });
const gimbal = { pitch_min_rad: -1.58, pitch_max_rad: 0.5, yaw_min_rad: -3.1, yaw_max_rad: 3.1 };
function facts(more: Record<string, unknown> = {}): VehicleFacts {
  return {
    id: '1',
    name: 'Quad 1',
    lost: false,
    offline: false,
    replayed: false,
    inAir: true,
    globalPosition: reading({ ...HERE, alt_amsl_m: 500, alt_home_m: 12 }),
    home: reading({ ...HERE, alt_amsl_m: 488 }),
    attitude: reading({ yaw_ned_rad: Math.PI / 2 }),
    gimbal: reading(gimbal),
    status: reading({ armed: true, mode: 'hold' }),
    ...more,
  } as unknown as VehicleFacts;
}
const EAST_30 = positionAt(HERE, { east_m: 30, north_m: 0 });
const point = (at: GeoPosition, ground_amsl_m: number | null = null): MapPoint => ({ ...at, ground_amsl_m, scenePixel: null });

describe('actions at a map point', () => {
  it('are all possible in the air with gimbal control', () => {
    expect(whyNotGo(facts(), point(EAST_30), 20)).toBeNull();
    expect(whyNotLook(facts(), EAST_30, 0, true)).toBeNull();
    expect(whyNotRoi(facts())).toBeNull();
  });
  it('offer the altitude of the vehicle, or of a take-off while it is on the ground, but never one below the ground', () => {
    const onGround = facts({ inAir: false, globalPosition: reading({ ...HERE, alt_amsl_m: 488, alt_home_m: 0 }) });
    expect(suggestedGoAlt_home_m(facts(), point(EAST_30), 10)).toBe(12);
    expect(suggestedGoAlt_home_m(onGround, point(EAST_30), 10)).toBe(10);
    expect(suggestedGoAlt_home_m(facts({ globalPosition: null }), point(EAST_30), 10)).toBe(10);
    expect(suggestedGoAlt_home_m(facts(), point(EAST_30, 508), 10)).toBe(25); // the ground is 20 m above home
    expect(suggestedGoAlt_home_m(onGround, point(EAST_30, 470), 10)).toBe(10);
  });
  it('are not possible below the ground at the point', () => {
    expect(whyNotGo(facts(), point(EAST_30, 508), 19.9)).toMatch(/20.0 m above home/);
    expect(whyNotGo(facts(), point(EAST_30, 508), 20)).toBeNull();
  });
  it('have a reason where they are not possible', () => {
    expect(whyNotGo(facts({ inAir: false }), point(EAST_30), 20)).toMatch(/take off first/);
    expect(whyNotGo(facts({ home: null }), point(EAST_30), 20)).toMatch(/home position is not known/);
    expect(whyNotGo(facts(), point(positionAt(HERE, { east_m: 1500, north_m: 0 })), 20)).toMatch(/1500 m away/);
    expect(whyNotLook(facts(), EAST_30, 0, false)).toMatch(/Take control/);
    expect(whyNotLook(facts({ gimbal: null }), EAST_30, 0, true)).toMatch(/no gimbal/);
    expect(whyNotLook(facts(), HERE, -1000, true)).toBeNull(); // straight down is −90°, within the limits
    expect(whyNotLook(facts(), EAST_30, 100, true)).toMatch(/range: pitch 71°/);
    const yawLimited = facts({ gimbal: reading({ ...gimbal, pitch_min_rad: null, pitch_max_rad: null, yaw_min_rad: -0.5, yaw_max_rad: 0.5 }) });
    expect(whyNotLook(yawLimited, positionAt(HERE, { east_m: 0, north_m: 30 }), 0, true)).toMatch(/range: −90° from the nose/);
    for (const [more, word] of [
      [{ replayed: true }, /replayed/],
      [{ lost: true }, /No connection/],
      [{ globalPosition: null }, /position/],
      [{ globalPosition: reading({ ...HERE, alt_amsl_m: 1, alt_home_m: 1 }, true) }, /position/],
    ] as const) {
      for (const why of [whyNotGo(facts(more), point(EAST_30), 20), whyNotLook(facts(more), EAST_30, 0, true), whyNotRoi(facts(more))])
        expect(why).toMatch(word);
    }
  });
  it('include "Set ROI" and "Look here" on the ground', () => {
    expect(whyNotRoi(facts({ inAir: false }))).toBeNull();
    expect(whyNotLook(facts({ inAir: false }), EAST_30, 0, true)).toBeNull();
  });
  it('use camera angles from the nose and from north', () => {
    const angles = lookAngles(facts(), EAST_30, 0);
    expect(angles?.yaw_deg).toBeCloseTo(0, 3); // the vehicle faces east
    expect(angles?.yaw_ned_deg).toBeCloseTo(90, 3);
    expect(angles?.pitch_deg).toBeCloseTo((-Math.atan2(12, 30) * 180) / Math.PI, 3);
    expect(lookAngles(facts({ attitude: null }), EAST_30, 0)).toBeNull();
  });
  it('have a distance, and a flight time if the speeds are known', () => {
    const speeds = { horizontal_m_s: 5, up_m_s: 3, down_m_s: 1.5 };
    expect(directionText(HERE, EAST_30)).toBe('30.0 m east of');
    expect(directionText(HERE, positionAt(HERE, { east_m: -5, north_m: 5 }))).toBe('7.1 m north-west of');
    expect(flightTime_s(facts(), EAST_30, 12, speeds)).toBeCloseTo(6, 1);
    expect(flightTime_s(facts(), EAST_30, 42, speeds)).toBeCloseTo(10, 1);
    expect(flightTime_s(facts(), EAST_30, 0, speeds)).toBeCloseTo(8, 1);
    expect(flightTime_s(facts(), EAST_30, 12, { ...speeds, horizontal_m_s: null })).toBeNull();
    expect(flightTime_s(facts(), EAST_30, 42, { ...speeds, up_m_s: null })).toBeNull();
    expect([altitudeInRange(NaN), altitudeInRange(5000), altitudeInRange(12.5)]).toEqual([null, 1000, 12.5]);
  });
  it('are in a menu beside the point, within the free area', () => {
    const free = { left: 12, top: 12, right: 936, bottom: 600 };
    const menu = { width: 300, height: 270 };
    expect(menuCorner({ x: 400, y: 300 }, menu, free)).toEqual({ x: 420, y: 210 });
    expect(menuCorner({ x: 900, y: 590 }, menu, free)).toEqual({ x: 580, y: 330 });
    expect(menuCorner({ x: 0, y: 0 }, menu, free)).toEqual({ x: 20, y: 12 });
  });
});

describe('a target of a vehicle', () => {
  const target = { ...EAST_30, alt_home_m: 12, since_s: 0 };
  it('stays on the map until it is reached or the mode changes', () => {
    expect(isTargetActive(target, facts(), 60)).toBe(true);
    expect(isTargetActive({ ...target, ...HERE }, facts(), 60)).toBe(false);
    expect(isTargetActive({ ...target, ...HERE, alt_home_m: 30 }, facts(), 60)).toBe(true);
    expect(isTargetActive(target, facts({ status: reading({ armed: true, mode: 'rtl' }) }), 60)).toBe(false);
    expect(isTargetActive(target, facts({ status: reading({ armed: true, mode: 'takeoff' }) }), 2)).toBe(true); // the vehicle has not reported the new mode yet
  });
});

describe('offline maps', () => {
  const file: MapFile = {
    name: 'a.pmtiles',
    url: '/api/v1/maps/a.pmtiles',
    format: 'pmtiles',
    tiles: 'raster',
    min_zoom: 3,
    max_zoom: 15,
    bounds_deg: [8, 47, 9, 48],
    attribution: '<a href="x">© Someone</a>',
    layers: [],
    bytes: 1,
  };
  it('are loaded only from this server', () => {
    expect(offlineMap(file, 'http://h').source).toMatchObject({ type: 'raster', url: 'pmtiles://http://h/api/v1/maps/a.pmtiles' });
    const tileSource = offlineMap({ ...file, format: 'mbtiles', tiles: 'vector', url: '/api/v1/maps/b' }, 'http://h').source;
    expect(tileSource).toMatchObject({ type: 'vector', tiles: ['http://h/api/v1/maps/b/{z}/{x}/{y}'], minzoom: 3, maxzoom: 15, bounds: [8, 47, 9, 48] });
  });
  it('show each attribution once, without markup', () => {
    expect(attributionText([file, file, { ...file, attribution: null }])).toBe('© Someone');
  });
});

describe('the middle of the free area', () => {
  const stage = { width: 1036, height: 628 };
  it('is between the panels on all sides', () => {
    expect(freeAreaOffset(stage, { left: 240, right: 344, top: 0, bottom: 56 })).toEqual({ x: -46, y: -34 });
    expect(freeAreaOffset(stage, { left: 240, right: 0, top: 0, bottom: 0 })).toEqual({ x: 126, y: 0 });
    expect(freeAreaOffset(stage, { left: 0, right: 0, top: 78, bottom: 56 })).toEqual({ x: 0, y: 11 });
    expect(freeAreaOffset(stage, { left: 0, right: 0, top: 0, bottom: 0 })).toEqual({ x: 0, y: 0 });
  });
  it('is computed with the panel that covers most at each edge', () => {
    expect(
      coveredAtEdges([
        { edge: 'left', px: 240 },
        { edge: 'left', px: 540 },
        { edge: 'right', px: 344 },
      ]),
    ).toEqual({ left: 540, right: 344, top: 0, bottom: 0 });
  });
  it('is the middle of the stage if panels cover the whole stage', () => {
    expect(freeAreaOffset({ width: 400, height: 50 }, { left: 240, right: 344, top: 0, bottom: 56 })).toEqual({ x: 0, y: 0 });
  });
  it('is sent to the 3D view as fractions of its size', () => {
    expect(offsetFractions({ x: -46, y: -34 }, stage)).toEqual([-0.0444, -0.0541]);
    expect(offsetFractions({ x: 126, y: 0 }, { width: 0, height: 0 })).toEqual([0, 0]);
  });
});
