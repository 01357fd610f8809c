/** Following the position of this device: its setpoint, its effect before and its progress after. Pure functions. */

import type { LayerContent } from '../../app/map-layers.svelte';
import { distanceText, heightText, shortText } from '../../ui/format';
import type { VehicleFacts } from '../../vehicle/facts';
import { eastNorth, groundDistance_m, positionAt, type GeoPosition } from '../../vehicle/geo';
import type { AnySetpoint, Validity } from '../../vehicle/setpoint';
import type { FollowNose } from './follow';
import { circle } from './guided';
import type { DevicePosition } from './locator.svelte';

/** The server refuses other positions (`gcs_server/streamer/device.py`). */
const MAX_ACCURACY_M = 20;
const MAX_AWAY_M = 200;
/** Without a position for this long the vehicle holds [s]. */
export const VALID_FOR_S = 4;
export const VALIDITY: Validity = { valid_for_s: VALID_FOR_S, on_expiry: { action: 'hold', hold_for_s: 2 }, renew: false };
const COMPASS_WORDS = [
  'north of it',
  'north-east of it',
  'east of it',
  'south-east of it',
  'south of it',
  'south-west of it',
  'west of it',
  'north-west of it',
];

/** Where the vehicle stays beside the device. */
export interface Beside {
  readonly offset_ne_m: readonly [number, number];
  readonly alt_home_m: number;
  readonly nose: FollowNose;
}

/** The place beside the device at a distance, on the side where the vehicle is now. */
export function besideOf(distance_m: number, alt_home_m: number, nose: FollowNose, device: GeoPosition, vehicle: GeoPosition): Beside {
  const { east_m, north_m } = eastNorth(device, vehicle);
  const away_m = Math.hypot(east_m, north_m);
  const [north, east] = away_m < 1 ? [1, 0] : [north_m / away_m, east_m / away_m];
  return { offset_ne_m: [north * distance_m, east * distance_m], alt_home_m, nose };
}

function sideText({ offset_ne_m: [north_m, east_m] }: Beside): string {
  return COMPASS_WORDS[(Math.round(Math.atan2(east_m, north_m) / (Math.PI / 4)) + 8) % 8] ?? '';
}

/** Why this device cannot be followed now; null: it can. */
export function whyNotDevice(distance_m: number, facts: VehicleFacts, device: DevicePosition | null, problem: string | null): string | null {
  if (problem !== null) return problem;
  if (device === null) return 'Waiting for the position of this device …';
  if (facts.offboard?.streaming === true) return 'The vehicle follows setpoints: Hold first, or change them in the Offboard view.';
  if (device.accuracy_m > Math.min(MAX_ACCURACY_M, distance_m))
    return `The position of this device is accurate to ${shortText('length', Math.ceil(device.accuracy_m))}: following needs ${shortText('length', MAX_ACCURACY_M)}, and no less than the distance.`;
  const position = facts.globalPosition?.value;
  const away_m = position === undefined ? 0 : groundDistance_m(position, device);
  return away_m > MAX_AWAY_M ? `This device is ${distanceText(away_m)} from the vehicle: at most ${shortText('length', MAX_AWAY_M)}.` : null;
}

/** What the vehicle does, as a clause with numbers. */
export function deviceText(beside: Beside, facts: VehicleFacts, device: DevicePosition): string {
  const position = facts.globalPosition?.value;
  const away_m = position === undefined ? null : groundDistance_m(position, device);
  const now = away_m === null ? '' : `, ${distanceText(away_m)} away now, accurate to ${shortText('length', Math.ceil(device.accuracy_m))}`;
  const distance_m = Math.round(Math.hypot(...beside.offset_ne_m));
  return `follows this device${now}; stays ${shortText('length', distance_m)} ${sideText(beside)} at ${heightText(beside.alt_home_m)} above home, not above you: on a slope keep more. It holds if no position comes for ${VALID_FOR_S} s, as when this page closes or the screen is off, if one is inaccurate or jumps, and at its limits`;
}

/** One position of the device as a setpoint. @param now_ms this computer's clock */
export function deviceSetpoint(beside: Beside, device: DevicePosition, now_ms: number): AnySetpoint {
  return {
    type: 'follow_device',
    lat_deg: device.lat_deg,
    lon_deg: device.lon_deg,
    accuracy_m: device.accuracy_m,
    age_s: Math.min(3600, Math.max(0, (now_ms - device.at_ms) / 1000)),
    ...(device.velocity_ne_m_s === null ? {} : { velocity_ne_m_s: device.velocity_ne_m_s }),
    offset_ne_m: beside.offset_ne_m,
    alt_home_m: beside.alt_home_m,
    yaw: beside.nose === 'face' ? 'face' : 'keep',
  };
}

/** The device with its accuracy, and where the vehicle will be. */
export function deviceContent(beside: Beside | null, facts: VehicleFacts, device: DevicePosition): LayerContent {
  const [position, home] = [facts.globalPosition?.value, facts.home?.value];
  const point = (id: string, at: GeoPosition, mark: 'cross' | 'disc') => ({ ...at, id, mark, tone: 'target' as const, text: '', selected: false });
  const at = { lat_deg: device.lat_deg, lon_deg: device.lon_deg };
  const [north_m, east_m] = beside?.offset_ne_m ?? [0, 0];
  const goal = positionAt(at, { north_m, east_m });
  const height = beside === null || home === undefined ? {} : { alt_amsl_m: home.alt_amsl_m + beside.alt_home_m };
  const lines =
    beside === null || position === undefined
      ? []
      : [
          {
            positions: [
              { lat_deg: position.lat_deg, lon_deg: position.lon_deg, alt_amsl_m: position.alt_amsl_m },
              { ...goal, ...height },
            ],
            tone: 'target' as const,
            style: 'dashed' as const,
          },
        ];
  return {
    points: [point('device', at, 'cross'), ...(beside === null ? [] : [{ ...point('goal', goal, 'disc'), ...height }])],
    lines: [...lines, { positions: circle(at, Math.max(1, device.accuracy_m)), tone: 'target', style: 'dotted' }],
    areas: [],
    ...(home === undefined ? {} : { ground: { lat_deg: home.lat_deg, lon_deg: home.lon_deg, alt_amsl_m: home.alt_amsl_m } }),
  };
}

/** How following goes on. */
export function deviceProgress(facts: VehicleFacts, device: DevicePosition | null, now_ms: number): string {
  const position = facts.globalPosition?.value;
  if (device === null || position === undefined) return 'Follows this device.';
  const age_s = Math.max(0, Math.round((now_ms - device.at_ms) / 1000));
  return `Follows this device: ${distanceText(groundDistance_m(position, device))} away; its position is ${age_s} s old, accurate to ${shortText('length', Math.ceil(device.accuracy_m))}.`;
}
