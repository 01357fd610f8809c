/** Titles and details of a mission's steps, and the default values of new steps. Pure functions. */

import { quantityOf } from '../../../vehicle/fields';
import { fixed, shortText } from '../../../ui/format';
import type { PlannedHome } from '../document/document';
import type { Mission, MissionPosition, Step, StepKind } from './mission';

const TITLES: Readonly<Record<StepKind, string>> = {
  take_off: 'Take off',
  fly: 'Trajectory',
  hold: 'Hold',
  orbit: 'Orbit',
  helix: 'Helix',
  spiral: 'Spiral',
  figure_eight: 'Figure-eight',
  table: 'Trajectory from a table',
  velocity: 'Velocity',
  attitude: 'Attitude',
  gimbal: 'Gimbal',
  photo: 'Photo',
  wait: 'Wait',
  repeat: 'Repeat',
  branch: 'If … then … otherwise',
  call: 'Fly a list of steps',
  land: 'Land',
  meet: 'Wait for the other vehicles',
};
export const STEP_KINDS = Object.keys(TITLES) as StepKind[];

export const GIMBAL_MODE_WORDS: Readonly<Record<string, string>> = {
  fixed: 'fixed to the vehicle',
  look_at: 'look at a point',
  along_path: 'along the path',
  sweep: 'sweep',
  release: 'release control',
};

/** Values that a condition can compare, with their units or quantities (`ui/units.ts`). */
export const CONDITION_VALUES: Readonly<Record<string, { readonly text: string; readonly unit: string }>> = {
  battery_share: { text: 'battery', unit: '%' },
  wind_speed_m_s: { text: 'wind', unit: 'speed' },
  ground_speed_m_s: { text: 'ground speed', unit: 'speed' },
  distance_m: { text: 'distance sensor', unit: 'length' },
  satellites: { text: 'satellites', unit: '' },
  horizontal_error_m: { text: 'estimated horizontal position error', unit: 'length' },
};
/** Factor from a fraction to per cent. */
export const PERCENT = 100;

export const stepKindTitle = (kind: StepKind): string => TITLES[kind];

/** The name of the step, or else the title of its kind. */
export function stepTitle(step: Step): string {
  return step.name != null && step.name !== '' ? step.name : TITLES[step.step];
}

const numberOrNull = (value: unknown): number | null => (typeof value === 'number' ? value : null);
const degreesText = (value: unknown): string => `${fixed(((numberOrNull(value) ?? 0) * 180) / Math.PI, 0)}°`;

function conditionText(condition: unknown): string {
  const { value, above, below, for_s } = (condition ?? {}) as { value?: string; above?: number | null; below?: number | null; for_s?: number };
  const { text, unit } = CONDITION_VALUES[value ?? ''] ?? { text: value ?? 'a value', unit: '' };
  const threshold = above ?? below ?? 0;
  const displayedThreshold = value === 'battery_share' ? threshold * PERCENT : threshold;
  const durationText = (for_s ?? 0) > 0 ? ` for ${fixed(for_s ?? 0, 0)} s` : '';
  return `${text} ${above != null ? 'above' : 'below'} ${shortText(unit, displayedThreshold)}${durationText}`;
}

/** The text below a step's title in the list. */
export function detailOf(step: Step): string {
  const parts: string[] = step.name != null && step.name !== '' ? [TITLES[step.step]] : [];
  /** Adds the text with the field's value in place of `#`, unless the value is 0 or missing. */
  const add = (field: string, text: string): void => {
    const value = numberOrNull(step[field]);
    if (value !== null && value !== 0) parts.push(text.replace('#', shortText(quantityOf(field).unit, value)));
  };
  switch (step.step) {
    case 'take_off':
      add('height_m', '# above the start');
      break;
    case 'fly':
      parts.push(`${step.points?.length ?? 0} ${step.points?.length === 1 ? 'point' : 'points'}`);
      if (step['curve'] === 'smooth') parts.push('smooth curve');
      break;
    case 'hold':
    case 'velocity':
    case 'attitude':
      add('duration_s', '#');
      break;
    case 'figure_eight':
      add('length_m', '# long');
      add('rounds', step['rounds'] === 1 ? '# lap' : '# laps');
      break;
    case 'table':
      parts.push(String(step['file'] ?? ''));
      break;
    case 'gimbal':
      parts.push(GIMBAL_MODE_WORDS[String(step['track'])] ?? '');
      if (step['track'] !== 'look_at' && step['track'] !== 'release') parts.push(`pitch ${degreesText(step['pitch_rad'])}`);
      break;
    case 'photo':
      parts.push(
        step['count'] === 1 || step['count'] === undefined
          ? '1 photo'
          : `${String(step['count'])} photos every ${fixed(numberOrNull(step['interval_s']) ?? 1, 1)} s`,
      );
      if (step['component'] != null) parts.push(`camera ${String(step['component'])}`);
      break;
    case 'wait':
      parts.push(step['until'] === 'person' ? 'for the operator' : `until ${conditionText(step['until'])}`);
      break;
    case 'repeat':
      parts.push(step['times'] === 1 ? 'one time' : `${String(step['times'])} times`);
      break;
    case 'branch':
      parts.push(`if ${conditionText(step['condition'])}`);
      break;
    case 'call':
      parts.push(step.mission ?? '');
      break;
    case 'orbit':
    case 'helix':
    case 'spiral':
      add('radius_m', 'radius #');
      add('turns', step['turns'] === 1 ? '# turn' : '# turns');
      if ((numberOrNull(step['climb_m']) ?? 0) < 0) parts.push(`descend ${shortText('height', -(step['climb_m'] as number))}`);
      else add('climb_m', 'climb #');
      add('end_radius_m', 'to radius #');
      break;
    case 'meet':
      parts.push(String(step['meeting'] ?? ''));
      break;
    case 'land':
  }
  add('speed_m_s', '≤ #');
  add('photo_every_m', 'photo every #');
  if (step['look_at'] != null) parts.push('heading towards a point');
  else if (step['heading'] === 'along_path') parts.push('heading along the path');
  return parts.join(' · ');
}

/** 10 m above the start. */
const DEFAULT_POSITION: MissionPosition = { offset_ned_m: [0, 0, -10] };

/** @param position the clicked position. */
export function newStep(kind: StepKind, position: MissionPosition = DEFAULT_POSITION): Step {
  const circle = { center: position, radius_m: 10, turns: 1, clockwise: true };
  const condition = { value: 'battery_share', above: 0.5 };
  const fields: Readonly<Record<StepKind, object>> = {
    take_off: { height_m: 10 },
    fly: { points: [position], curve: 'straight' },
    hold: { duration_s: 10 },
    orbit: circle,
    helix: { ...circle, turns: 3, climb_m: 10 },
    spiral: { ...circle, turns: 3, end_radius_m: 20, climb_m: 0 },
    figure_eight: { center: position, length_m: 40, width_m: 20, rounds: 1, axis_ned_rad: 0 },
    table: { file: 'path.csv', relative: true },
    velocity: { velocity_ned_m_s: [1, 0, 0], duration_s: 5 },
    attitude: { roll_rad: 0, pitch_rad: 0, thrust: 0.5, duration_s: 1 },
    gimbal: { track: 'fixed', pitch_rad: -Math.PI / 4, yaw_rad: 0 },
    photo: { count: 1, interval_s: 1 },
    wait: { until: 'person', message: 'Continue?', timeout_s: 300, on_timeout: 'hold' },
    repeat: { times: 2, steps: [{ step: 'hold', duration_s: 5 }] },
    branch: { condition, then: [], otherwise: [] },
    call: { mission: '' },
    land: {},
    meet: { meeting: 'meeting' },
  };
  return { step: kind, ...fields[kind] };
}

/** Kinds of steps that a person places with a click on the map. */
export const KINDS_WITH_POSITION: ReadonlySet<StepKind> = new Set<StepKind>(['fly', 'orbit', 'helix', 'spiral', 'figure_eight']);

/** A mission with take-off and landing; new steps are inserted between them. */
export function newMission(home: PlannedHome | null): Mission {
  return {
    format: 'offboard-gcs-mission',
    version: 1,
    name: 'New mission',
    description: '',
    home,
    limits: {} as Mission['limits'],
    avoidance: false,
    actions: { failure: 'hold', low_battery: 'return', link_loss: 'hold' } as Mission['actions'],
    fence: [],
    steps: [newStep('take_off'), newStep('land')],
    missions: {},
    tables: {},
  };
}
