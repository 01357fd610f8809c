/** The editor's rows of a step, a trajectory point and a mission. Some fields of a step have several rows. Pure functions. */

import { boundsOf, quantityOf, type FieldValue, type ShownField } from '../../../vehicle/fields';
import { positionFields } from './position-fields';
import type { MissionFrame } from './positions';
import type { Mission, MissionPosition, Step, StepKind } from './mission';
import { PERCENT, GIMBAL_MODE_WORDS, CONDITION_VALUES } from './step-titles';

/** One row of the editor. */
export interface Field<T> extends ShownField {
  readonly name: string;
  readonly set: (target: T, value: FieldValue) => T;
}

/** The data besides the step that determine the rows of a step. */
export interface RowContext {
  readonly mission: Mission;
  readonly frame: MissionFrame;
}

/** Returns the rows for one field of the document. */
type RowSpec = (step: Step, context: RowContext) => Field<Step>[];

/** What a row has besides its quantity; limits here are narrower than the API's. */
type Details = Partial<Pick<ShownField, 'min' | 'max' | 'step' | 'placeholder'>>;

/** A number field of any object; its name gives the unit. @param model the API's model of the object, which has the bounds. */
export function numberField<T extends object>(target: T, model: string, name: string, label: string, details: Details = {}): Field<T> {
  const { scale, ...quantity } = quantityOf(name, boundsOf(model, name));
  const value = (target as Record<string, unknown>)[name];
  return {
    name,
    label,
    type: 'number',
    ...quantity,
    value: typeof value === 'number' ? value * scale : null,
    // An empty field removes the value from the document.
    set: (old, next) =>
      typeof next === 'number' ? { ...old, [name]: next / scale } : (Object.fromEntries(Object.entries(old).filter(([key]) => key !== name)) as T),
    ...details,
  };
}

function choiceField<T extends object>(target: T, name: string, label: string, options: Readonly<Record<string, string>>): Field<T> {
  return {
    name,
    label,
    type: 'choice',
    value: String((target as Record<string, unknown>)[name] ?? Object.keys(options)[0] ?? ''),
    options: Object.entries(options).map(([value, text]) => ({ value, text })),
    set: (old, next) => ({ ...old, [name]: next }),
  };
}

const numberRow =
  (name: string, label: string, details: Details = {}): RowSpec =>
  (step) => [numberField(step, `step_${step.step}`, name, label, details)];
const choiceRow =
  (name: string, label: string, options: Readonly<Record<string, string>>): RowSpec =>
  (step) => [choiceField(step, name, label, options)];
const switchRow =
  (name: string, label: string, fallback = false): RowSpec =>
  (step) => [
    { name, label, type: 'switch', value: step[name] === undefined ? fallback : step[name] === true, set: (old, next) => ({ ...old, [name]: next === true }) },
  ];
const textRow =
  (name: string, label: string): RowSpec =>
  (step) => [
    { name, label, type: 'text', value: (step[name] as string | null | undefined) ?? '', set: (old, next) => ({ ...old, [name]: next === '' ? null : next }) },
  ];
const positionRows =
  (name: string, label: string): RowSpec =>
  (step, { frame }) =>
    positionFields<Step>(step[name] as MissionPosition, frame, (old, next) => ({ ...old, [name]: next }), label, name);

const UNCHANGED: Details = { placeholder: 'unchanged' };
export const ACTIONS = { continue: 'Continue', hold: 'Hold', return: 'Return', land: 'Land' };

/** The rows of the heading: the choice of a mode, and the value of this mode. */
const headingRows: RowSpec = (step, context) => {
  const mode = step['look_at'] != null ? 'look_at' : step['yaw_ned_rad'] != null ? 'yaw' : step['heading'] === 'along_path' ? 'along_path' : 'keep';
  const rows: Field<Step>[] = [
    {
      name: 'heading',
      label: 'Heading',
      type: 'choice',
      value: mode,
      options: [
        { value: 'keep', text: 'unchanged' },
        { value: 'along_path', text: 'along the path' },
        { value: 'yaw', text: 'fixed yaw' },
        { value: 'look_at', text: 'towards a point' },
      ],
      set: (old, next) => {
        const { yaw_ned_rad: _yaw, look_at: _lookAt, ...rest } = old;
        if (next === 'yaw') return { ...rest, step: old.step, heading: 'keep', yaw_ned_rad: 0 };
        if (next === 'look_at')
          return { ...rest, step: old.step, heading: 'keep', look_at: old['center'] ?? old.points?.at(-1) ?? { offset_ned_m: [0, 0, 0] } };
        return { ...rest, step: old.step, heading: next };
      },
    },
  ];
  if (mode === 'yaw') rows.push(numberField(step, `step_${step.step}`, 'yaw_ned_rad', 'Yaw from north'));
  if (mode === 'look_at') rows.push(...positionRows('look_at', 'Point to face')(step, context));
  return rows;
};

/** Converts a choice to the document's value. In a document, true also means `over`; in a step, null means the mission's value. */
const avoidanceOf = (choice: FieldValue): 'over' | 'around' | false => (choice === 'over' || choice === 'around' ? choice : false);
const avoidanceRow = (value: unknown) =>
  choiceField({ avoidance: value === true ? 'over' : value === false ? 'off' : value }, 'avoidance', 'Avoid obstacles', {
    off: 'off',
    over: 'over them',
    around: 'around them',
  });
const stepAvoidanceRow: RowSpec = (step) => {
  const row = avoidanceRow(step['avoidance'] ?? '');
  return [
    {
      ...row,
      options: [{ value: '', text: 'as set for the mission' }, ...(row.options ?? [])],
      set: (old, next) => ({ ...old, avoidance: next === '' ? null : avoidanceOf(next) }),
    },
  ];
};
const PATH_ROWS: readonly RowSpec[] = [
  numberRow('speed_m_s', 'Maximum speed', { placeholder: 'default' }),
  headingRows,
  numberRow('photo_every_m', 'Photo every', { placeholder: 'none' }),
  stepAvoidanceRow,
];
const CIRCLE_ROWS: readonly RowSpec[] = [
  positionRows('center', 'Centre'),
  numberRow('radius_m', 'Radius'),
  numberRow('turns', 'Turns', { step: 0.5 }),
  switchRow('clockwise', 'Clockwise, seen from above', true),
  numberRow('start_angle_ned_rad', 'Start bearing', { placeholder: 'nearest' }),
];

/** The rows of a condition: value, comparison, threshold and duration. */
function conditionRows(field: string): RowSpec {
  return (step) => {
    const storedCondition = (step[field] ?? {}) as { value?: string; above?: number | null; below?: number | null; for_s?: number };
    const comparison = storedCondition.above != null ? 'above' : 'below';
    const scale = storedCondition.value === 'battery_share' ? PERCENT : 1;
    const withFields = (old: Step, fields: object): Step => ({ ...old, [field]: { ...(old[field] as object), ...fields } });
    return [
      {
        ...choiceField(step, 'value', 'Value', Object.fromEntries(Object.entries(CONDITION_VALUES).map(([value, { text }]) => [value, text]))),
        name: `${field}-value`,
        value: storedCondition.value ?? '',
        set: (old, next) => withFields(old, { value: next }),
      },
      {
        name: `${field}-side`,
        label: 'Comparison',
        type: 'choice',
        value: comparison,
        options: [
          { value: 'above', text: 'above' },
          { value: 'below', text: 'below' },
        ],
        set: (old, next) =>
          withFields(old, {
            above: next === 'above' ? (storedCondition.above ?? storedCondition.below ?? 0) : undefined,
            below: next === 'below' ? (storedCondition.below ?? storedCondition.above ?? 0) : undefined,
          }),
      },
      {
        name: `${field}-bound`,
        label: 'Threshold',
        type: 'number',
        unit: CONDITION_VALUES[storedCondition.value ?? '']?.unit ?? '',
        value: (storedCondition.above ?? storedCondition.below ?? 0) * scale,
        set: (old, next) => withFields(old, { [comparison]: typeof next === 'number' ? next / scale : 0 }),
      },
      {
        name: `${field}-for`,
        label: 'For at least',
        type: 'number',
        unit: 's',
        ...boundsOf('Condition', 'for_s'),
        value: storedCondition.for_s ?? 0,
        set: (old, next) => withFields(old, { for_s: next ?? 0 }),
      },
    ];
  };
}

const untilRows: RowSpec = (step, context) => [
  {
    name: 'until',
    label: 'Until',
    type: 'choice',
    value: step['until'] === 'person' ? 'person' : 'condition',
    options: [
      { value: 'person', text: 'the operator continues' },
      { value: 'condition', text: 'a condition is true' },
    ],
    set: (old, next) => ({ ...old, until: next === 'person' ? 'person' : { value: 'battery_share', above: 0.5, for_s: 0 } }),
  },
  ...(step['until'] === 'person' ? textRow('message', 'Question')(step, context) : conditionRows('until')(step, context)),
];

const velocityRows: RowSpec = (step) => {
  const storedVelocity = (step['velocity_ned_m_s'] as readonly number[] | undefined) ?? [0, 0, 0];
  return [
    ['North', 0, 1],
    ['East', 1, 1],
    ['Up', 2, -1],
  ].map(([label, index, sign]): Field<Step> => {
    const [axis, factor] = [index as number, sign as number];
    const set = (old: Step, next: FieldValue): Step => ({
      ...old,
      velocity_ned_m_s: storedVelocity.map((component, i) => (i === axis ? factor * (typeof next === 'number' ? next : 0) : component)),
    });
    return {
      name: `velocity-${axis}`,
      label: String(label),
      type: 'number',
      unit: axis === 2 ? 'climb' : 'speed',
      step: 0.5,
      min: -50,
      max: 50,
      value: factor * (storedVelocity[axis] ?? 0) + 0,
      set,
    };
  });
};

const gimbalRows: RowSpec = (step, context) => {
  const rows: Field<Step>[] = [
    {
      ...choiceField(step, 'track', 'Gimbal mode', GIMBAL_MODE_WORDS),
      // Only the mode `look_at` has a position.
      set: (old, next) => ({ ...old, track: next, place: next === 'look_at' ? (old['place'] ?? { offset_ned_m: [0, 0, 0] }) : null }),
    },
  ];
  const add = (...specs: readonly RowSpec[]): void => specs.forEach((spec) => rows.push(...spec(step, context)));
  const track = step['track'];
  if (track === 'look_at') add(positionRows('place', 'Look at'));
  else if (track !== 'release') add(numberRow('pitch_rad', 'Pitch, up is positive', { min: -90, max: 90 }));
  if (track === 'fixed' || track === 'sweep') add(numberRow('yaw_rad', 'Yaw from the vehicle’s heading'));
  if (track === 'sweep')
    add(numberRow('sweep_pitch_rad', 'Sweep up and down (±)'), numberRow('sweep_yaw_rad', 'Sweep to the sides (±)'), numberRow('period_s', 'Period'));
  return rows;
};

const nameChoiceRow =
  (field: string, label: string, source: 'missions' | 'tables', emptyText: string): RowSpec =>
  (step, { mission }) => {
    const names = Object.keys(mission[source] ?? {});
    const currentName = String(step[field] ?? '');
    const options = Object.fromEntries(
      [...new Set([...(names.includes(currentName) ? [] : [currentName]), ...names])].map((name) => [name, name === '' ? emptyText : name]),
    );
    return [choiceField(step, field, label, options)];
  };

const STEP_ROWS: Readonly<Record<StepKind, readonly RowSpec[]>> = {
  take_off: [numberRow('height_m', 'Height above the start'), numberRow('timeout_s', 'Timeout', { placeholder: '60' })],
  fly: [choiceRow('curve', 'Curve', { straight: 'straight legs', smooth: 'smooth' }), ...PATH_ROWS],
  hold: [numberRow('duration_s', 'Duration'), numberRow('yaw_ned_rad', 'Yaw from north', UNCHANGED)],
  orbit: [...CIRCLE_ROWS, ...PATH_ROWS],
  helix: [...CIRCLE_ROWS, numberRow('climb_m', 'Altitude gain (negative: descent)'), ...PATH_ROWS],
  spiral: [...CIRCLE_ROWS, numberRow('end_radius_m', 'Radius at the end'), numberRow('climb_m', 'Altitude gain (negative: descent)'), ...PATH_ROWS],
  figure_eight: [
    positionRows('center', 'Centre'),
    numberRow('length_m', 'Length'),
    numberRow('width_m', 'Width of a loop'),
    numberRow('rounds', 'Laps', { step: 0.5 }),
    numberRow('axis_ned_rad', 'Bearing of the long axis'),
    ...PATH_ROWS,
  ],
  table: [nameChoiceRow('file', 'Table', 'tables', 'no table'), switchRow('relative', 'Positions relative to the start of the mission', true)],
  velocity: [velocityRows, numberRow('duration_s', 'Duration'), numberRow('yaw_ned_rad', 'Yaw from north', UNCHANGED)],
  attitude: [
    numberRow('roll_rad', 'Roll'),
    numberRow('pitch_rad', 'Pitch'),
    numberRow('yaw_ned_rad', 'Yaw from north', UNCHANGED),
    numberRow('thrust', 'Thrust, 0 to 1', { step: 0.05 }),
    numberRow('duration_s', 'Duration'),
  ],
  gimbal: [gimbalRows],
  photo: [numberRow('count', 'Photos'), numberRow('interval_s', 'Time between photos'), numberRow('component', 'Camera', { placeholder: 'first' })],
  wait: [untilRows, numberRow('timeout_s', 'Timeout'), choiceRow('on_timeout', 'On timeout', ACTIONS)],
  repeat: [numberRow('times', 'Times')],
  branch: [conditionRows('condition')],
  call: [nameChoiceRow('mission', 'List of steps', 'missions', 'choose …')],
  land: [numberRow('timeout_s', 'Timeout', { placeholder: '300' })],
  meet: [textRow('meeting', 'Name of the meeting'), numberRow('timeout_s', 'Timeout', { placeholder: '120' })],
};
/** Fields with whole numbers; the page rounds typed fractions. */
const INTEGER_FIELDS: ReadonlySet<string> = new Set(['times', 'count']);

/** The rows of a step; the first row is the name. */
export function fieldsOf(step: Step, context: RowContext): Field<Step>[] {
  const rows = [...textRow('name', 'Name')(step, context), ...STEP_ROWS[step.step].flatMap((spec) => spec(step, context))];
  return rows.map((row) =>
    INTEGER_FIELDS.has(row.name) ? { ...row, set: (old, next) => row.set(old, typeof next === 'number' ? Math.round(next) : next) } : row,
  );
}

/** The rows of one point of a trajectory. */
export function pointFields(point: MissionPosition, { frame }: RowContext): Field<MissionPosition>[] {
  return [
    ...positionFields<MissionPosition>(point, frame, (_, next) => next, 'Position', 'point'),
    numberField(point, 'FlyPoint', 'yaw_ned_rad', 'Yaw from north', UNCHANGED),
    numberField(point, 'FlyPoint', 'hold_s', 'Wait at the point', { placeholder: '0' }),
    numberField(point, 'FlyPoint', 'corner_m', 'Corner rounding: maximum distance from the point', { placeholder: '1' }),
    { name: 'stop', label: 'Stop at the point', type: 'switch', value: point['stop'] === true, set: (old, next) => ({ ...old, stop: next === true }) },
  ];
}

const EVENT_LABELS: Readonly<Record<string, string>> = {
  failure: 'If a step cannot be flown',
  low_battery: 'Low battery (mission’s action)',
  link_loss: 'Once a lost connection is restored',
  control_lost: 'Controlling client lost',
};

/** The rows of the whole mission: failsafe actions, obstacle avoidance and limits. */
export function missionFields(mission: Mission): Field<Mission>[] {
  const actions = mission.actions as unknown as Readonly<Record<string, string>>;
  const limits = mission.limits as unknown as Readonly<Record<string, number | null>>;
  const limitField = (label: string, name: string): Field<Mission> => {
    const { set, ...row } = numberField(limits, 'Bounds', name, label, { placeholder: 'vehicle limit' });
    return {
      ...row,
      set: (old, next) => ({ ...old, limits: set(old.limits as unknown as Readonly<Record<string, number | null>>, next) as unknown as Mission['limits'] }),
    };
  };
  return [
    ...Object.entries(EVENT_LABELS)
      .filter(([name]) => actions[name] !== undefined)
      .map(([name, label]): Field<Mission> => {
        const { set: _, ...row } = choiceField(actions, name, label, name === 'low_battery' ? { ...ACTIONS, continue: 'No action by the mission' } : ACTIONS);
        return { ...row, set: (old, next) => ({ ...old, actions: { ...old.actions, [name]: next } }) };
      }),
    { ...avoidanceRow(mission.avoidance), set: (old, next) => ({ ...old, avoidance: avoidanceOf(next) }) },
    limitField('Maximum speed', 'speed_m_s'),
    limitField('Maximum climb speed', 'climb_m_s'),
    limitField('Maximum descent speed', 'descent_m_s'),
    limitField('Maximum acceleration', 'acceleration_m_s2'),
    limitField('Maximum jerk', 'jerk_m_s3'),
    limitField('Maximum tilt', 'tilt_rad'),
    limitField('Maximum yaw rate', 'yaw_rate_rad_s'),
  ];
}
