/** The plan as one list: home, steps, geofence, rally points. Pure. */

import { fixed } from '../../ui/format';
import type { IconName } from '../../ui/icons';
import type { FenceZone, PlannedHome, Plan } from './document';
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

export function fenceEntries(fence: readonly FenceZone[]): TreeEntry[] {
  return fence.map((zone, index) => ({ ...entry, ids: zoneIds(zone, index), mark: '▱', tone: zone.inclusion ? 'caution' : 'danger', ...zoneText(zone) }));
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
    ...fenceEntries(plan.fence),
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
