/** Commands in guided flight: their values, what PX4 limits, their effect before and their progress after. Pure functions. */

import { boundIn, unitText } from '../../ui/units';
import { BOUNDS } from '../../api/bounds';
import type { ConfirmationTexts } from '../../app/actions/actions';
import type { FuturesBody } from '../../app/futures/futures';
import type { LayerContent, LayerPosition } from '../../app/map-layers.svelte';
import { distanceText, heading, heightText, lengthText, shortText, speedText, UNKNOWN, wrap180 } from '../../ui/format';
import type { VehicleFacts } from '../../vehicle/facts';
import { bearing_rad, groundDistance_m, positionAt, type GeoPosition } from '../../vehicle/geo';
import { followProgress, followText, whyNotFollow, type Following, type FollowNose } from './follow';

/** `device` follows the position of this device; `go` needs a position from the map; `orbit` and `home` use the vehicle's position without one, `heading` the entered number. */
export type Kind = 'go' | 'altitude' | 'heading' | 'speed' | 'orbit' | 'follow' | 'device' | 'home';
export type Field = 'alt_home_m' | 'yaw_ned_deg' | 'speed_m_s' | 'radius_m' | 'behind_m' | 'above_m' | 'distance_m';
export type Nose = 'vehicle' | 'center' | 'initial' | 'tangent' | 'uncontrolled';

export const KIND_NAMES: Readonly<Record<Kind, string>> = {
  go: 'Go to',
  altitude: 'Altitude',
  heading: 'Heading',
  speed: 'Speed',
  orbit: 'Orbit',
  follow: 'Follow',
  device: 'Follow this device',
  home: 'Home',
};
/** Text of the button of each command, and of its confirmation. */
export const VERBS: Readonly<Record<Kind, string>> = {
  go: 'Go',
  altitude: 'Change altitude',
  heading: 'Turn',
  speed: 'Change speed',
  orbit: 'Orbit',
  follow: 'Follow',
  device: 'Follow this device',
  home: 'Set home',
};
export const NOSE_NAMES: Readonly<Record<Nose, string>> = {
  vehicle: 'As the vehicle is set',
  center: 'To the centre',
  initial: 'Keeps its heading',
  tangent: 'Along the circle',
  uncontrolled: 'Free',
};
/** The number fields of each command; a field in `OPTIONAL` may be empty. */
export const FIELDS: Readonly<Record<Kind, readonly Field[]>> = {
  go: ['alt_home_m', 'speed_m_s', 'yaw_ned_deg'],
  altitude: ['alt_home_m'],
  heading: ['yaw_ned_deg'],
  speed: ['speed_m_s'],
  orbit: ['radius_m', 'speed_m_s', 'alt_home_m'],
  follow: ['behind_m', 'above_m'],
  device: ['distance_m', 'alt_home_m'],
  home: [],
};
const OPTIONAL: Readonly<Partial<Record<Kind, readonly Field[]>>> = { go: ['speed_m_s', 'yaw_ned_deg'] };
export const FIELD_NAMES: Readonly<Record<Field, { readonly label: string; readonly unit: string; readonly step: number }>> = {
  alt_home_m: { label: 'Altitude above home', unit: 'height', step: 1 },
  yaw_ned_deg: { label: 'Heading', unit: '°', step: 5 },
  speed_m_s: { label: 'Ground speed', unit: 'speed', step: 0.5 },
  radius_m: { label: 'Radius', unit: 'length', step: 1 },
  behind_m: { label: 'Behind it', unit: 'length', step: 1 },
  above_m: { label: 'Above it', unit: 'height', step: 1 },
  distance_m: { label: 'Distance', unit: 'length', step: 1 },
};

/** A vehicle's limits and speeds, from its parameters; null: not known. */
export const PARAMETERS = {
  speedMax_m_s: 'MPC_XY_VEL_MAX',
  cruise_m_s: 'MPC_XY_CRUISE',
  up_m_s: 'MPC_Z_V_AUTO_UP',
  down_m_s: 'MPC_Z_V_AUTO_DN',
  turn_deg_s: 'MPC_YAWRAUTO_MAX',
  radiusMax_m: 'MC_ORBIT_RAD_MAX',
  returnAlt_m: 'RTL_RETURN_ALT',
  fenceRadius_m: 'GF_MAX_HOR_DIST',
  fenceHeight_m: 'GF_MAX_VER_DIST',
  fenceAction: 'GF_ACTION',
} as const;
export type Limits = Readonly<Record<keyof typeof PARAMETERS, number | null>>;
export const NO_LIMITS = Object.fromEntries(Object.keys(PARAMETERS).map((name) => [name, null])) as Limits;

export interface Place extends GeoPosition {
  /** Altitude of the ground AMSL, if the view knows it. */
  readonly ground_amsl_m: number | null;
}

export interface Draft {
  readonly kind: Kind;
  /** The position from the map; null: the vehicle's own. */
  readonly place: Place | null;
  readonly texts: Readonly<Record<Field, string>>;
  readonly clockwise: boolean;
  readonly nose: Nose;
  /** Id of the vehicle to follow; empty: not chosen. */
  readonly leader: string;
  readonly followNose: FollowNose;
}

/** Centripetal acceleration at which PX4 limits the speed of an orbit [m/s²]. */
const ORBIT_ACCELERATION_M_S2 = 2;
const CIRCLE_POINTS = 48;
const HEADING_LINE_M = 30;
/** Distances from a device that is followed, and heights above home [m]; the server refuses others. */
const DEVICE_DISTANCES = { min: 5, max: 200, name: null };
const DEVICE_HEIGHTS = { min: 5, max: 500, name: null };
/** Largest offset from a followed vehicle [m]. */
const FOLLOW_RANGE_M = 200;

/** The number that a field contains; null: it is empty; NaN: it is no number. */
export function numberOf(draft: Draft, field: Field): number | null {
  const text = draft.texts[field].trim().replace(',', '.').replace('−', '-');
  return text === '' ? null : Number(text);
}

/** The number of a field that has no problem. */
function number(draft: Draft, field: Field): number {
  return numberOf(draft, field) ?? NaN;
}

export function orbitSpeedMax_m_s(radius_m: number): number {
  return Math.sqrt(ORBIT_ACCELERATION_M_S2 * radius_m);
}

function boundsOf(field: Field, limits: Limits): { min: number; max: number; name: string | null } {
  if (field === 'alt_home_m') return { ...BOUNDS.GotoRequest.alt_home_m, name: null };
  if (field === 'yaw_ned_deg') return { ...BOUNDS.HeadingRequest.yaw_ned_deg, name: null };
  if (field === 'behind_m' || field === 'above_m') return { min: -FOLLOW_RANGE_M, max: FOLLOW_RANGE_M, name: null };
  const [{ min, max }, limit, name] =
    field === 'speed_m_s'
      ? [BOUNDS.SpeedRequest.speed_m_s, limits.speedMax_m_s, PARAMETERS.speedMax_m_s]
      : [BOUNDS.OrbitRequest.radius_m, limits.radiusMax_m, PARAMETERS.radiusMax_m];
  return limit === null ? { min, max, name: null } : { min, max: limit, name };
}

/** Why a field's value cannot be sent; null: it can. */
export function fieldProblem(draft: Draft, field: Field, limits: Limits): string | null {
  const value = numberOf(draft, field);
  const { label, unit } = FIELD_NAMES[field];
  if (value === null) return OPTIONAL[draft.kind]?.includes(field) === true ? null : `${label}: enter a number.`;
  const { min, max, name } = draft.kind === 'device' ? (field === 'distance_m' ? DEVICE_DISTANCES : DEVICE_HEIGHTS) : boundsOf(field, limits);
  if (!(value >= min && value <= max))
    return `From ${boundIn(unit, min, 'up')} to ${fixedShort(boundIn(unit, max, 'down'))} ${unitText(unit)}${name === null ? '' : ` (${name})`}.`;
  if (draft.kind !== 'orbit' || field !== 'speed_m_s') return null;
  const radius_m = numberOf(draft, 'radius_m');
  if (radius_m === null || !(radius_m > 0) || value <= orbitSpeedMax_m_s(radius_m)) return null;
  return `At ${shortText('length', radius_m)} the vehicle flies at most ${shortText('speed', Math.floor(orbitSpeedMax_m_s(radius_m) * 10) / 10)}.`;
}

function fixedShort(value: number): string {
  return String(Math.round(value * 10) / 10);
}

/** Where the command acts: the position from the map, or else the vehicle's. */
export function placeOf(draft: Draft, facts: VehicleFacts): GeoPosition | null {
  return draft.place ?? facts.globalPosition?.value ?? null;
}

/** Nearer than this, a place has no direction [m]. */
const MIN_AWAY_M = 1;

/** The heading in which a place is from the vehicle, as a field's text; empty: the vehicle is there, or its position is not known. */
export function headingTo(place: GeoPosition, facts: VehicleFacts): string {
  const position = facts.globalPosition?.value;
  if (position === undefined || groundDistance_m(position, place) < MIN_AWAY_M) return '';
  return String(Number(heading((bearing_rad(position, place) * 180) / Math.PI)));
}

/** Where the draft wants the vehicle beside the followed one. */
export function followingOf(draft: Draft): Following {
  return { behind_m: number(draft, 'behind_m'), above_m: number(draft, 'above_m'), nose: draft.followNose };
}

/**
 * Why the command cannot be given now; null: it can.
 * @param leader the vehicle to follow; null: none is chosen.
 */
export function whyNot(draft: Draft, facts: VehicleFacts, limits: Limits, leader: VehicleFacts | null = null): string | null {
  if (facts.replayed) return 'A replayed vehicle accepts no commands.';
  if (facts.lost) return 'No connection to the vehicle.';
  if (facts.globalPosition === null || facts.globalPosition.stale) return 'The vehicle’s position is not known.';
  const mode = facts.status?.value.mode ?? '';
  if (draft.kind === 'home') {
    if (facts.offboard?.streaming === true) return 'The vehicle follows setpoints, whose limits and altitudes refer to home: Hold first.';
    return facts.inAir && (mode === 'rtl' || mode === 'mission') ? `${facts.status?.value.mode_label} refers to the present home: Hold first.` : null;
  }
  if (!facts.inAir) return 'The vehicle is on the ground: take off first.';
  if (facts.home === null) return 'The home position is not known.';
  if (draft.kind === 'go' && draft.place === null) return 'Click on the map, then choose “Go with speed or heading…”.';
  if (draft.kind === 'speed' && mode !== 'hold' && mode !== 'mission') return 'The speed can be changed in Hold and Mission. An orbit has its own speed.';
  const problem = FIELDS[draft.kind].map((field) => fieldProblem(draft, field, limits)).find((each) => each !== null);
  if (problem !== undefined || draft.kind !== 'follow') return problem ?? null;
  return whyNotFollow(followingOf(draft), facts, leader);
}

/** The limit of the geofence around home; null: none, not known, or the geofence does nothing. */
function fenceLimit(limits: Limits, field: 'fenceRadius_m' | 'fenceHeight_m'): number | null {
  const value_m = limits[field];
  return value_m === null || value_m <= 0 || limits.fenceAction === 0 ? null : value_m;
}

/** How the command leaves the limits of the geofence around home; empty: it does not. The server compares the stored geofence too. */
export function fenceText(draft: Draft, facts: VehicleFacts, limits: Limits): string {
  const [home, at] = [facts.home?.value, placeOf(draft, facts)];
  if (home === undefined || at === null || (draft.kind !== 'go' && draft.kind !== 'orbit' && draft.kind !== 'altitude')) return '';
  const [radius_m, height_m] = [fenceLimit(limits, 'fenceRadius_m'), fenceLimit(limits, 'fenceHeight_m')];
  const away_m = groundDistance_m(home, at) + (draft.kind === 'orbit' ? number(draft, 'radius_m') : 0);
  const alt_m = number(draft, 'alt_home_m');
  const texts = [
    draft.kind !== 'altitude' && radius_m !== null && away_m > radius_m
      ? `Up to ${distanceText(away_m)} from home: the geofence allows ${shortText('length', radius_m)} (${PARAMETERS.fenceRadius_m}).`
      : '',
    height_m !== null && alt_m > height_m ? `Above the geofence, which allows ${shortText('height', height_m)} above home (${PARAMETERS.fenceHeight_m}).` : '',
  ];
  return texts.filter(Boolean).join(' ');
}

function seconds(value_s: number): string {
  return `about ${Math.max(1, Math.round(value_s))} s`;
}

/** Time of a climb or descent [s]; null: its speed is not known. */
function climbTime_s(climb_m: number, limits: Limits): number | null {
  const speed_m_s = climb_m > 0 ? limits.up_m_s : limits.down_m_s;
  return speed_m_s === null || speed_m_s <= 0 ? null : Math.abs(climb_m) / speed_m_s;
}

/** What the vehicle does with the command, as sentences with numbers. @param leader the vehicle to follow */
export function effectText(draft: Draft, facts: VehicleFacts, limits: Limits, leader: VehicleFacts | null = null): string {
  const position = facts.globalPosition?.value;
  const at = placeOf(draft, facts);
  if (position === undefined || at === null) return '';
  const leaves =
    draft.kind !== 'home' && draft.kind !== 'speed' && facts.status?.value.mode !== 'hold' ? ` Leaves ${facts.status?.value.mode_label ?? UNKNOWN}.` : '';
  const stream = facts.offboard?.streaming === true && draft.kind !== 'home' && draft.kind !== 'speed' ? ' Offboard ends.' : '';
  const away_m = groundDistance_m(position, at);
  const alt_m = number(draft, 'alt_home_m');
  const climb_m = alt_m - position.alt_home_m;
  switch (draft.kind) {
    case 'go': {
      const speed_m_s = numberOf(draft, 'speed_m_s') ?? limits.cruise_m_s;
      const yaw_deg = numberOf(draft, 'yaw_ned_deg');
      const time_s = speed_m_s === null ? null : Math.max(away_m / speed_m_s, climbTime_s(climb_m, limits) ?? 0);
      const nose = yaw_deg === null ? '' : ` The nose points to ${heading(yaw_deg)}°.`;
      return `Flies ${distanceText(away_m)} at ${speed_m_s === null ? 'its own speed' : shortText('speed', speed_m_s)} to ${heightText(alt_m)} above home${time_s === null ? '' : ` in ${seconds(time_s)}`} and holds there.${nose}${leaves}${stream}`;
    }
    case 'altitude': {
      const time_s = climbTime_s(climb_m, limits);
      return `${climb_m < 0 ? 'Descends' : 'Climbs'} ${heightText(Math.abs(climb_m))} to ${heightText(alt_m)} above home${time_s === null ? '' : ` in ${seconds(time_s)}`}; a flight to a position continues.${leaves}${stream}`;
    }
    case 'heading': {
      const turn_deg = wrap180(number(draft, 'yaw_ned_deg') - (position.heading_deg ?? NaN));
      const turn = Number.isFinite(turn_deg) ? ` ${Math.round(Math.abs(turn_deg))}° to the ${turn_deg < 0 ? 'left' : 'right'}` : '';
      const rate = limits.turn_deg_s === null ? '' : `, at up to ${fixedShort(limits.turn_deg_s)} °/s (${PARAMETERS.turn_deg_s})`;
      const once = draft.place === null ? '' : ' The nose points to this place once: it does not follow it.';
      return `Turns${turn} to ${heading(number(draft, 'yaw_ned_deg'))}°${rate}.${once}${leaves}${stream}`;
    }
    case 'speed':
      return `Flies to positions and the mission at ${shortText('speed', number(draft, 'speed_m_s'))} until the next change of mode${limits.cruise_m_s === null ? '' : `; its default is ${shortText('speed', limits.cruise_m_s)}`}.`;
    case 'orbit': {
      const [radius_m, speed_m_s] = [number(draft, 'radius_m'), number(draft, 'speed_m_s')];
      const round_s = (2 * Math.PI * radius_m) / speed_m_s;
      const approach_m = Math.abs(away_m - radius_m);
      return `Flies ${distanceText(approach_m)} to a circle of ${shortText('length', radius_m)} radius at ${heightText(alt_m)} above home, and circles ${draft.clockwise ? 'clockwise' : 'counter-clockwise'} at ${shortText('speed', speed_m_s)}, ${seconds(round_s)} a round, until another command.${leaves}${stream}`;
    }
    case 'device':
      return ''; // `device.svelte.ts`, which is loaded with the panel
    case 'follow':
      return leader === null ? '' : `${followText(followingOf(draft), facts, leader)}${leaves}`;
    case 'home':
      return homeText(draft, facts, limits, at);
  }
}

/** What changes with home: Return and the altitudes above home. */
function homeText(draft: Draft, facts: VehicleFacts, limits: Limits, at: GeoPosition): string {
  const [position, home] = [facts.globalPosition?.value, facts.home?.value];
  if (position === undefined) return '';
  const alt_amsl_m = draft.place === null ? position.alt_amsl_m : (draft.place.ground_amsl_m ?? home?.alt_amsl_m ?? null);
  const moved = home === undefined ? '' : `, ${distanceText(groundDistance_m(home, at))} from the present home`;
  const returns = ` Return flies here and lands here${limits.returnAlt_m === null ? '' : `, at ${shortText('height', limits.returnAlt_m)} above this home`}.`;
  const above_m = alt_amsl_m === null ? null : position.alt_amsl_m - alt_amsl_m;
  const heights = above_m === null ? '' : ` Altitudes above home count from here: the vehicle is then at ${heightText(above_m)}.`;
  return `Sets home to ${draft.place === null ? 'the vehicle’s position and altitude' : 'this position'}${moved}.${returns}${heights} Geofence and limits around home move with it. The vehicle sets home again when it is armed.`;
}

export function confirmationTexts(draft: Draft, facts: VehicleFacts, limits: Limits): ConfirmationTexts {
  const effect = [effectText(draft, facts, limits), fenceText(draft, facts, limits)].filter(Boolean).join(' ');
  return { title: `${KIND_NAMES[draft.kind]}: ${facts.name}`, effect, verb: VERBS[draft.kind], danger: false };
}

/** What the server flies in simulation before the command is given; null: nothing. */
export function futuresOf(draft: Draft, { lat_deg, lon_deg }: GeoPosition): FuturesBody | null {
  const alt_home_m = number(draft, 'alt_home_m');
  if (draft.kind === 'altitude') return { altitude: { alt_home_m } };
  if (draft.kind === 'orbit') {
    const circle = { lat_deg, lon_deg, alt_home_m, radius_m: number(draft, 'radius_m'), speed_m_s: number(draft, 'speed_m_s') };
    return { orbit: { ...circle, clockwise: draft.clockwise, ...(draft.nose === 'vehicle' ? {} : { yaw: draft.nose }) } };
  }
  if (draft.kind !== 'go') return null;
  const [speed_m_s, yaw_ned_deg] = [numberOf(draft, 'speed_m_s'), numberOf(draft, 'yaw_ned_deg')];
  return { goto: { lat_deg, lon_deg, alt_home_m, ...(speed_m_s === null ? {} : { speed_m_s }), ...(yaw_ned_deg === null ? {} : { yaw_ned_deg }) } };
}

export function circle(centre: GeoPosition, radius_m: number): GeoPosition[] {
  return Array.from({ length: CIRCLE_POINTS + 1 }, (_, index) => {
    const angle = (2 * Math.PI * index) / CIRCLE_POINTS;
    return positionAt(centre, { east_m: radius_m * Math.sin(angle), north_m: radius_m * Math.cos(angle) });
  });
}

/** What the map shows of a command before it is given, with the geofence around home; null: nothing. */
export function previewContent(draft: Draft, facts: VehicleFacts, limits: Limits = NO_LIMITS): LayerContent | null {
  const content = commandPreview(draft, facts);
  const [home, radius_m] = [facts.home?.value, fenceLimit(limits, 'fenceRadius_m')];
  if (content === null || home === undefined || radius_m === null || (draft.kind !== 'go' && draft.kind !== 'orbit')) return content;
  return { ...content, lines: [...content.lines, { positions: circle(home, radius_m), tone: 'caution', style: 'dashed' }] };
}

function commandPreview(draft: Draft, facts: VehicleFacts): LayerContent | null {
  const position = facts.globalPosition?.value;
  const [at, home] = [placeOf(draft, facts), facts.home?.value];
  if (position === undefined || at === null) return null;
  const up = (place: GeoPosition): LayerPosition => ({
    ...place,
    alt_amsl_m: (home?.alt_amsl_m ?? position.alt_amsl_m) + (numberOf(draft, 'alt_home_m') ?? 0),
  });
  const ground = home === undefined ? {} : { ground: { lat_deg: home.lat_deg, lon_deg: home.lon_deg, alt_amsl_m: home.alt_amsl_m } };
  const vehicle = { lat_deg: position.lat_deg, lon_deg: position.lon_deg, alt_amsl_m: position.alt_amsl_m };
  const point = (mark: 'cross' | 'home' | 'disc') => ({ ...at, id: 'target', mark, tone: 'target' as const, text: '', selected: false });
  switch (draft.kind) {
    case 'go':
      return draft.place === null
        ? null
        : { points: [point('disc')], lines: [{ positions: [vehicle, up(at)], tone: 'target', style: 'dashed' }], areas: [], ...ground };
    case 'home':
      return {
        points: [point('home')],
        lines: home === undefined ? [] : [{ positions: [{ lat_deg: home.lat_deg, lon_deg: home.lon_deg }, at], tone: 'target', style: 'dashed' }],
        areas: [],
        ...ground,
      };
    case 'heading': {
      const yaw_rad = (number(draft, 'yaw_ned_deg') * Math.PI) / 180;
      if (!Number.isFinite(yaw_rad)) return null;
      const end = positionAt(position, { east_m: HEADING_LINE_M * Math.sin(yaw_rad), north_m: HEADING_LINE_M * Math.cos(yaw_rad) });
      return {
        points: draft.place === null ? [] : [point('cross')],
        lines: [{ positions: [vehicle, { ...end, alt_amsl_m: position.alt_amsl_m }], tone: 'target', style: 'dashed' }],
        areas: [],
        ...ground,
      };
    }
    case 'orbit': {
      const radius_m = number(draft, 'radius_m');
      if (!(radius_m >= BOUNDS.OrbitRequest.radius_m.min && radius_m <= BOUNDS.OrbitRequest.radius_m.max)) return null;
      const outward_rad = groundDistance_m(at, position) < 0.5 ? 0 : bearing_rad(at, position);
      const start = positionAt(at, { east_m: radius_m * Math.sin(outward_rad), north_m: radius_m * Math.cos(outward_rad) });
      const lines = [
        { positions: circle(at, radius_m).map(up), tone: 'target' as const, style: 'dashed' as const },
        { positions: [vehicle, up(start)], tone: 'target' as const, style: 'dotted' as const },
      ];
      return { points: [point('cross')], lines, areas: [], ...ground };
    }
    default:
      return null;
  }
}

/** The circle that the vehicle flies now; null: it is not in Orbit, or has not reported the circle lately. */
export function flownCircle(facts: VehicleFacts): LayerContent | null {
  const orbit = facts.orbit;
  if (orbit === null || orbit.stale || facts.status?.value.mode !== 'orbit') return null;
  const { lat_deg, lon_deg, radius_m, alt_amsl_m } = orbit.value;
  const centre = { lat_deg, lon_deg };
  const height = alt_amsl_m === null ? {} : { alt_amsl_m };
  const home = facts.home?.value;
  return {
    points: [{ ...centre, id: 'centre', mark: 'cross', tone: 'target', text: '', selected: false }],
    lines: [{ positions: circle(centre, radius_m).map((place) => ({ ...place, ...height })), tone: 'target', style: 'solid' }],
    areas: [],
    ...(home === undefined ? {} : { ground: { lat_deg: home.lat_deg, lon_deg: home.lon_deg, alt_amsl_m: home.alt_amsl_m } }),
  };
}

/** A command that the vehicle has accepted. */
export interface Accepted {
  readonly draft: Draft;
  /** Where it acted. */
  readonly at: GeoPosition;
}

export interface Progress {
  readonly text: string;
  readonly ended: boolean;
}

/** How far an accepted command has been carried out. @param leader the vehicle that is followed */
export function progressOf({ draft, at }: Accepted, facts: VehicleFacts, leader: VehicleFacts | null = null): Progress {
  const position = facts.globalPosition?.value;
  const mode = facts.status?.value.mode ?? '';
  const label = facts.status?.value.mode_label ?? UNKNOWN;
  if (position === undefined) return { text: 'The vehicle’s position is not known.', ended: false };
  switch (draft.kind) {
    case 'follow':
      return followProgress(facts, leader, leader?.name ?? draft.leader);
    case 'home':
      return { text: 'Home is set.', ended: true };
    case 'heading':
      return { text: `Turned to ${heading(number(draft, 'yaw_ned_deg'))}°.`, ended: true };
    case 'speed':
      return {
        text: `Ground speed ${speedText(facts.hud?.value.groundspeed_m_s)} now, ${shortText('speed', number(draft, 'speed_m_s'))} commanded.`,
        ended: false,
      };
    case 'orbit': {
      if (mode !== 'orbit' || facts.orbit === null) return { text: `The orbit has ended: the vehicle is in ${label}.`, ended: true };
      const { radius_m, clockwise } = facts.orbit.value;
      const away_m = groundDistance_m(facts.orbit.value, position);
      const directionText = clockwise ? 'clockwise' : 'counter-clockwise';
      return { text: `Orbit of ${shortText('length', radius_m)}, ${directionText}: ${lengthText(away_m)} from the centre.`, ended: false };
    }
    default: {
      if (mode !== 'hold') return { text: `Interrupted: the vehicle is in ${label}.`, ended: true };
      const alt_m = number(draft, 'alt_home_m');
      const left_m = draft.kind === 'go' ? Math.hypot(groundDistance_m(position, at), alt_m - position.alt_home_m) : Math.abs(alt_m - position.alt_home_m);
      if (left_m < 1.5) return { text: draft.kind === 'go' ? 'Reached the position.' : `Reached ${heightText(alt_m)} above home.`, ended: true };
      return { text: `${lengthText(left_m)} left.`, ended: false };
    }
  }
}
