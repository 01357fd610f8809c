/** The plan as one list: home, steps, geofence, obstacles, rally points. Pure. */

import { fixed } from '../../../ui/format';
import type { IconName } from '../../../ui/icons';
import { obstaclesOf, type FenceZone, type Obstacle, type PlannedHome, type Plan, type SharedParts } from './document';
import { altitudeText, detailOf, titleOf } from './items';

export interface TreeEntry {
  /** Ids of all points of the entry, such as the corners of a fence. */
  readonly ids: readonly string[];
  /** Row of an item. */
  readonly row: number | null;
  readonly mark: string;
  readonly icon: IconName | null;
  readonly tone: 'target' | 'caution' | 'danger' | 'actual' | 'dim';
  readonly title: string;
  readonly detail: string;
  /** The server's name of a mission's step. */
  readonly step?: string;
  /** Nesting depth. */
  readonly depth?: number;
  /** Heading of the list that begins here: `then`, `otherwise`, or the called mission. */
  readonly heading?: string;
  /** Duration. */
  readonly side?: string;
}

/** Ids of the points of a fence zone. */
export function zoneIds(zone: FenceZone, index: number): string[] {
  return zone.shape === 'circle' ? [`circle:${index}`] : zone.polygon.map((_, corner) => `corner:${index}:${corner}`);
}

export function zoneText(zone: FenceZone): { title: string; detail: string } {
  const title = zone.inclusion ? 'Geofence: stay inside' : 'Geofence: stay outside';
  return { title, detail: zone.shape === 'circle' ? `circle, radius ${fixed(zone.radius_m, 0)} m` : `${zone.polygon.length} corners` };
}

const entry = { row: null, mark: '', icon: null };

export function homeEntry(home: PlannedHome | null): TreeEntry[] {
  return home === null ? [] : [{ ...entry, ids: ['home'], icon: 'home', tone: 'dim', title: 'Home', detail: `${fixed(home.alt_amsl_m, 1)} m AMSL` }];
}

/** Ids of the corners of an obstacle. */
export function obstacleIds(obstacle: Obstacle, index: number): string[] {
  return obstacle.polygon.map((_, corner) => `obstacle:${index}:${corner}`);
}

export function obstacleTitle(obstacle: Obstacle, index: number): string {
  return (obstacle.name ?? '').trim() === '' ? `Obstacle ${index + 1}` : (obstacle.name ?? '');
}

/** The geofence and the obstacles. */
export function sharedEntries(document: SharedParts): TreeEntry[] {
  return [
    ...document.fence.map((zone, index): TreeEntry => ({
      ...entry,
      ids: zoneIds(zone, index),
      mark: '▱',
      tone: zone.inclusion ? 'caution' : 'danger',
      ...zoneText(zone),
    })),
    ...obstaclesOf(document).map((obstacle, index): TreeEntry => ({
      ...entry,
      ids: obstacleIds(obstacle, index),
      mark: '▲',
      tone: 'danger',
      title: obstacleTitle(obstacle, index),
      detail: `obstacle, top ${altitudeText(obstacle.top)}`,
    })),
  ];
}

export function treeOf(plan: Plan): TreeEntry[] {
  return [
    ...homeEntry(plan.planned_home),
    ...plan.items.map((item, row) => ({
      ...entry,
      ids: [`item:${row}`],
      row,
      mark: String(row + 1),
      tone: 'target' as const,
      title: titleOf(item),
      detail: detailOf(item),
    })),
    ...sharedEntries(plan),
    ...plan.rally_points.map((point, index) => ({
      ...entry,
      ids: [`rally:${index}`],
      mark: 'R',
      tone: 'actual' as const,
      title: 'Rally point',
      detail: altitudeText(point.altitude),
    })),
  ];
}
