/** The plan as one list: home, items, geofence, obstacles, rally points. Pure functions. */

import { heightText, lengthText } from '../../../ui/format';
import type { IconName } from '../../../ui/icons';
import { obstaclesOf, type FenceZone, type Obstacle, type PlannedHome, type Plan, type DocumentAreas } from './document';
import { altitudeText, detailOf, titleOf } from './items';

export interface ListEntry {
  /** Ids of all points of the entry, such as the corners of a fence. */
  readonly ids: readonly string[];
  /** Row of an item of a waypoint plan; null for other entries. */
  readonly row: number | null;
  /** Text in the circle before the title; empty if the entry has an icon. */
  readonly symbol: string;
  readonly icon: IconName | null;
  readonly tone: 'target' | 'caution' | 'danger' | 'actual' | 'dim';
  readonly title: string;
  readonly detail: string;
  /** The server's name of a step of an offboard mission: "step 3", "step 4.2". */
  readonly stepPlace?: string;
  /** Nesting depth. */
  readonly depth?: number;
  /** Heading of the list of steps that begins with this entry: `then`, `otherwise`, the name of a called list, or a role. */
  readonly listHeading?: string;
  /** Estimated duration and number of photos of a step. */
  readonly estimateText?: string;
}

/** Ids of the points of a fence zone. */
export function zonePointIds(zone: FenceZone, index: number): string[] {
  return zone.shape === 'circle' ? [`circle:${index}`] : zone.polygon.map((_, corner) => `corner:${index}:${corner}`);
}

export function zoneText(zone: FenceZone): { title: string; detail: string } {
  const title = zone.inclusion ? 'Geofence: stay inside' : 'Geofence: stay outside';
  return { title, detail: zone.shape === 'circle' ? `circle, radius ${lengthText(zone.radius_m, 0)}` : `${zone.polygon.length} corners` };
}

const BASE_ENTRY = { row: null, symbol: '', icon: null };

export function homeEntry(home: PlannedHome | null): ListEntry[] {
  return home === null ? [] : [{ ...BASE_ENTRY, ids: ['home'], icon: 'home', tone: 'dim', title: 'Home', detail: `${heightText(home.alt_amsl_m)} AMSL` }];
}

/** Ids of the corners of an obstacle. */
export function obstacleCornerIds(obstacle: Obstacle, index: number): string[] {
  return obstacle.polygon.map((_, corner) => `obstacle:${index}:${corner}`);
}

export function obstacleTitle(obstacle: Obstacle, index: number): string {
  return (obstacle.name ?? '').trim() === '' ? `Obstacle ${index + 1}` : (obstacle.name ?? '');
}

/** The geofence and the obstacles. */
export function areaEntries(document: DocumentAreas): ListEntry[] {
  return [
    ...document.fence.map((zone, index): ListEntry => ({
      ...BASE_ENTRY,
      ids: zonePointIds(zone, index),
      symbol: '▱',
      tone: zone.inclusion ? 'caution' : 'danger',
      ...zoneText(zone),
    })),
    ...obstaclesOf(document).map((obstacle, index): ListEntry => ({
      ...BASE_ENTRY,
      ids: obstacleCornerIds(obstacle, index),
      symbol: '▲',
      tone: 'danger',
      title: obstacleTitle(obstacle, index),
      detail: `obstacle, top ${altitudeText(obstacle.top)}`,
    })),
  ];
}

export function planEntries(plan: Plan): ListEntry[] {
  return [
    ...homeEntry(plan.planned_home),
    ...plan.items.map((item, row) => ({
      ...BASE_ENTRY,
      ids: [`item:${row}`],
      row,
      symbol: String(row + 1),
      tone: 'target' as const,
      title: titleOf(item),
      detail: detailOf(item),
    })),
    ...areaEntries(plan),
    ...plan.rally_points.map((point, index) => ({
      ...BASE_ENTRY,
      ids: [`rally:${index}`],
      symbol: 'R',
      tone: 'actual' as const,
      title: 'Rally point',
      detail: altitudeText(point.altitude),
    })),
  ];
}
