import { expect, test } from 'vitest';
import {
  matchingParameters,
  groupsOf,
  NO_FILTER,
  numberText,
  valueProblem,
  rangeText,
  stateText,
  parseTypedNumber,
  valueText,
  type ParameterMetadata,
  type Parameter,
} from './params';

const metadata = (more: Partial<ParameterMetadata>): ParameterMetadata => ({
  name: '',
  is_integer: false,
  group: 'G',
  category: 'Standard',
  title: null,
  details: null,
  default: null,
  min: null,
  max: null,
  unit: null,
  decimals: null,
  increment: null,
  choices: [],
  bits: [],
  reboot_required: false,
  volatile: false,
  ...more,
});
const parameter = (name: string, value: number | null, more: Partial<ParameterMetadata> | null = {}, is_default: boolean | null = true): Parameter => ({
  name,
  value,
  is_integer: Number.isInteger(value),
  is_default,
  facts: more === null ? null : metadata(more),
});
const parameters = [
  parameter('MPC_XY_VEL_MAX', 12, { title: 'Maximum speed', group: 'Position' }),
  parameter('COM_OBL_RC_ACT', 0, { title: 'Offboard loss', group: 'Commander' }, false),
  parameter('A_MPC', 1, null, null),
];

test('a search finds words in names and descriptions, and lists names that begin with the text first', () => {
  expect(matchingParameters(parameters, { ...NO_FILTER, text: 'mpc' }).map((p) => p.name)).toEqual(['MPC_XY_VEL_MAX', 'A_MPC']);
  expect(matchingParameters(parameters, { ...NO_FILTER, text: 'speed max' }).map((p) => p.name)).toEqual(['MPC_XY_VEL_MAX']);
  expect(matchingParameters(parameters, { ...NO_FILTER, nonDefaultOnly: true }).map((p) => p.name)).toEqual(['COM_OBL_RC_ACT']);
  expect(matchingParameters(parameters, { ...NO_FILTER, group: 'Position' })).toHaveLength(1);
  expect(matchingParameters(parameters, NO_FILTER)).toHaveLength(3);
  expect(groupsOf(parameters)).toEqual(['Commander', 'Position']);
});

test('the list can be that of the favourites', () => {
  const found = matchingParameters(parameters, { ...NO_FILTER, favouritesOnly: true }, new Set(['A_MPC']));
  expect(found.map((p) => p.name)).toEqual(['A_MPC']);
});

test('a value is shown with its label, unit and decimals', () => {
  expect(valueText(parameter('A', 0.10000000149011612, { unit: 's', decimals: 2 }))).toBe('0.10 s');
  expect(valueText(parameter('A', 1, { choices: [{ value: 1, label: 'Land' }] }))).toBe('Land');
  expect(
    valueText(
      parameter('A', 5, {
        bits: [
          { value: 0, label: 'a' },
          { value: 1, label: 'b' },
          { value: 2, label: 'c' },
        ],
      }),
    ),
  ).toBe('a, c');
  expect(valueText(parameter('A', 1310988, { is_integer: true, decimals: 3 }))).toBe('1310988');
  expect(valueText(parameter('A', null))).toBe('–');
  expect(valueText(parameter('A', -1.5, null))).toBe('−1.5');
  expect(numberText(0.12345, 1)).toBe('0.12345');
  expect(numberText(4, 2)).toBe('4.00');
  expect(rangeText(metadata({ min: 0, max: 20, unit: 'm/s' }))).toBe('0 to 20 m/s');
  expect(rangeText(metadata({ max: 90, unit: 'deg' }))).toBe('at most 90°');
  expect(rangeText(metadata({ min: 2, unit: 'm/s^2' }))).toBe('at least 2 m/s²');
  expect(rangeText(metadata({ min: -1, max: 1, unit: 'norm' }))).toBe('−1 to 1');
  expect(rangeText(metadata({ min: -1 }))).toBe('at least −1');
  expect(rangeText(metadata({}))).toBe('');
});

test('only a number, or an integer where required, is read from typed text', () => {
  expect([parseTypedNumber('12,5', false), parseTypedNumber(' −3 ', true), parseTypedNumber('.5', false), parseTypedNumber('1e3', true)]).toEqual([
    12.5, -3, 0.5, 1000,
  ]);
  expect([
    parseTypedNumber('', false),
    parseTypedNumber('1.5', true),
    parseTypedNumber('abc', false),
    parseTypedNumber('1e999', false),
    parseTypedNumber('0x10', true),
  ]).toEqual([null, null, null, null, null]);
});

test('a value outside range, enum or bits has a problem text', () => {
  const speed = metadata({ min: 3, max: 20, unit: 'm/s' });
  expect([valueProblem(speed, 99), valueProblem(speed, 2.9)]).toEqual([
    'Outside the documented range: 3 to 20 m/s.',
    'Outside the documented range: 3 to 20 m/s.',
  ]);
  expect([valueProblem(speed, 20), valueProblem(speed, 3), valueProblem(null, 1e9), valueProblem(metadata({ min: 0.1 }), Math.fround(0.1))]).toEqual([
    null,
    null,
    null,
    null,
  ]);
  const action = metadata({ choices: [{ value: 1, label: 'Land' }] });
  expect([valueProblem(action, 1), valueProblem(action, 2)]).toEqual([null, 'Not one of the documented values.']);
  const bitmask = metadata({
    bits: [
      { value: 0, label: 'a' },
      { value: 4, label: 'b' },
    ],
  });
  expect([valueProblem(bitmask, 17), valueProblem(bitmask, 0)]).toEqual([null, null]);
  expect(valueProblem(bitmask, 2)).not.toBeNull();
  expect(valueProblem(bitmask, -1)).not.toBeNull();
});

test('the state text shows the progress of reading', () => {
  const list = {
    state: 'reading',
    received: 3,
    count: 929,
    source: null,
    hash: null,
    read_unix_s: null,
    problem: null,
    facts: false,
    facts_problem: null,
    left_out: 0,
  } as const;
  expect(stateText(null)).toBe('not read yet');
  expect(stateText(list)).toBe('reading 3 of 929 …');
  expect(stateText({ ...list, state: 'ready', received: 929, source: 'cache' })).toContain('unchanged');
});
