/** Titles and details of a plan's items, and the kinds that can be added. Pure functions. */

import { fixed, heightText, lengthText, speedText } from '../../../ui/format';
import type { GeoPosition } from '../../../vehicle/geo';
import { isPatternItem, isPlaced, ROI_KINDS, type Altitude, type Item, type ItemKind, type AltitudeReference, type Pattern } from './document';
import { altitudeOf, isStale } from './pattern-items';
import { optionText, specsOf, type EditableKind } from './item-fields';

const TITLES: Readonly<Record<ItemKind, string>> = {
  takeoff: 'Take off',
  waypoint: 'Waypoint',
  loiter_time: 'Hold',
  loiter_unlimited: 'Hold until another command',
  loiter_to_altitude: 'Climb or descend',
  gate: 'Gate',
  change_speed: 'Change speed',
  land: 'Land',
  return_home: 'Return',
  photo_start: 'Take photos',
  photo_stop: 'Stop taking photos',
  trigger_distance: 'Photos by distance',
  trigger_interval: 'Set photo interval',
  trigger_control: 'Camera trigger',
  oblique_survey: 'Oblique photos by distance',
  video_start: 'Start video',
  video_stop: 'Stop video',
  camera_mode: 'Camera mode',
  camera_focus: 'Camera focus',
  camera_zoom: 'Camera zoom',
  gimbal_pitch_yaw: 'Gimbal angles',
  roi_location: 'Set region of interest',
  roi_next_waypoint: 'Look at the next waypoint',
  roi_none: 'Clear region of interest',
  gimbal_configure: 'Gimbal control',
  gripper: 'Gripper',
  winch: 'Winch',
  set_actuator: 'Set actuators',
  set_servo: 'Set servo',
  delay: 'Wait',
  jump: 'Jump',
  set_home: 'Set home at the vehicle’s position',
  land_start: 'Landing sequence start',
  roi: 'Region of interest (older command)',
  mount_configure: 'Gimbal mode (older command)',
  mount_control: 'Gimbal angles (older command)',
  control_video: 'Video (older command)',
  digicam: 'Take a photo (older command)',
  command: 'Other command',
  complex: 'Pattern',
  pattern: 'Pattern',
};

/** Names of the patterns. */
export const PATTERN_TITLES: Readonly<Record<Pattern['kind'], string>> = {
  survey: 'Survey',
  corridor: 'Corridor',
  perimeter: 'Perimeter',
  orbit: 'Orbit around a point',
  structure: 'Structure scan',
};

const REFERENCE_TEXTS: Readonly<Record<AltitudeReference, string>> = { home: 'above home', amsl: 'AMSL', terrain: 'above terrain' };

export const REFERENCE_CHOICES = (Object.keys(REFERENCE_TEXTS) as AltitudeReference[]).map((value) => ({ value, text: REFERENCE_TEXTS[value] }));

export function altitudeText(altitude: Altitude): string {
  return `${heightText(altitude.value_m)} ${REFERENCE_TEXTS[altitude.reference]}`;
}

export function titleOf(item: Pick<Item, 'kind'> & { readonly [field: string]: unknown }): string {
  if (item.kind === 'complex') return `Pattern (${String(item['complex_type'])})`;
  if (item.kind === 'pattern') return PATTERN_TITLES[(item['pattern'] as Pattern).kind];
  if (item.kind === 'trigger_distance' && item['distance_m'] === 0) return 'Stop taking photos';
  if (item.kind === 'command') return `MAV_CMD ${String(item['command'])}`;
  return TITLES[item.kind];
}

const numberIn = (item: Item, field: string): number | null => (typeof item[field] === 'number' ? item[field] : null);

/** Fields whose chosen option is shown in the text below the title. */
const DETAIL_FIELDS: Readonly<Partial<Record<ItemKind, readonly string[]>>> = {
  change_speed: ['speed_type'],
  trigger_control: ['enable'],
  camera_mode: ['mode'],
  camera_focus: ['focus_type'],
  camera_zoom: ['zoom_type'],
  gripper: ['action'],
  winch: ['action'],
  mount_configure: ['mode'],
};

/** Negative speeds with a special meaning (MAV_CMD_DO_CHANGE_SPEED). */
const SPECIAL_SPEEDS: Readonly<Record<number, string>> = { '-1': 'unchanged', '-2': 'default' };

/** The text below an item's title in the list. */
export function detailOf(item: Item): string {
  const parts: string[] = [];
  const add = (field: string, text: (value: number) => string): void => {
    const value = numberIn(item, field);
    if (value !== null && value !== 0) parts.push(text(value));
  };
  if (isPlaced(item)) parts.push(altitudeText(item.altitude));
  if (isPatternItem(item)) parts.push(altitudeText(altitudeOf(item.pattern)), isStale(item) ? 'making the lines …' : `${item.items.length} items`);
  if (item.kind === 'complex') parts.push(`${item.items?.length ?? 0} items, made by another program`);
  if (item.kind === 'jump')
    parts.push(
      `to item ${(numberIn(item, 'target_index') ?? 0) + 1}`,
      numberIn(item, 'repeat') === -1 ? 'endless' : item['repeat'] === 1 ? 'once' : `${String(item['repeat'])} times`,
    );
  if (item.kind === 'takeoff' || item.kind === 'land') return parts.join(' · ');
  parts.push(...(DETAIL_FIELDS[item.kind] ?? []).flatMap((field) => optionText(item, field) ?? []));
  add('hold_s', (s) => `hold ${fixed(s, 0)} s`);
  add('delay_s', (s) => (s < 0 ? 'until a UTC time' : `${fixed(s, 0)} s`));
  add('speed_m_s', (v) => SPECIAL_SPEEDS[v] ?? speedText(v));
  add('distance_m', (m) => `every ${lengthText(m)}`);
  add('interval_s', (s) => `every ${fixed(s, 1)} s`);
  if (item.kind === 'trigger_interval') add('interval_ms', (ms) => (ms < 0 ? 'unchanged' : `every ${fixed(ms / 1000, 1)} s`));
  add('count', (n) => `${n} ${n === 1 ? 'photo' : 'photos'}`);
  add('pitch_deg', (deg) => `pitch ${fixed(deg, 0)}°`);
  add('yaw_deg', (deg) => `yaw ${fixed(deg, 0)}°`);
  return parts.join(' · ');
}

/** Kinds of items that a person places with a click on the map. */
const KINDS_WITH_POSITION: ReadonlySet<ItemKind> = new Set([
  'takeoff',
  'waypoint',
  'loiter_time',
  'loiter_unlimited',
  'loiter_to_altitude',
  'gate',
  'land',
  'roi_location',
  'roi',
]);

export function needsPosition(kind: ItemKind): boolean {
  return KINDS_WITH_POSITION.has(kind);
}

/** The kinds that can be added, in groups: all except `set_servo` and `camera_zoom`, which PX4 refuses. */
export const KIND_GROUPS: readonly { readonly label: string; readonly folded: boolean; readonly kinds: readonly EditableKind[] }[] = [
  {
    label: 'Movement',
    folded: false,
    kinds: ['takeoff', 'waypoint', 'loiter_time', 'loiter_unlimited', 'loiter_to_altitude', 'gate', 'change_speed', 'land', 'return_home'],
  },
  {
    label: 'Camera',
    folded: true,
    kinds: [
      'photo_start',
      'photo_stop',
      'trigger_distance',
      'trigger_interval',
      'trigger_control',
      'oblique_survey',
      'video_start',
      'video_stop',
      'camera_mode',
      'camera_focus',
    ],
  },
  { label: 'Gimbal', folded: true, kinds: ['gimbal_pitch_yaw', 'roi_location', 'roi_next_waypoint', 'roi_none', 'gimbal_configure'] },
  { label: 'Payload', folded: true, kinds: ['gripper', 'winch', 'set_actuator'] },
  { label: 'Mission flow', folded: true, kinds: ['delay', 'jump', 'set_home', 'land_start'] },
  { label: 'Older commands', folded: true, kinds: ['roi', 'mount_configure', 'mount_control', 'control_video', 'digicam'] },
];

/** @param position null for a kind without a position. */
export function newItem(kind: ItemKind, position: GeoPosition | null, altitude: Altitude): Item {
  const isOnGround = kind === 'land' || ROI_KINDS.has(kind);
  const placement =
    position === null ? {} : { lat_deg: position.lat_deg, lon_deg: position.lon_deg, altitude: { ...altitude, value_m: isOnGround ? 0 : altitude.value_m } };
  const fields = Object.fromEntries(specsOf(kind).map(([name, { initial }]) => [name, initial]));
  return { kind, autocontinue: true, spare_params: [], original: null, ...fields, ...placement };
}
