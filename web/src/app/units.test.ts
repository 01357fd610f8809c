/** What is shown and typed in other units than SI: nothing that nobody has changed changes, and bounds can be typed. */

import { afterEach, describe, expect, it } from 'vitest';
import { seeded } from './page.fixture';
import { boundsOf, limitProblem, parseNumber, quantityOf } from '../vehicle/fields';
import { areaText, distanceText, heightText, roundLengthAbove_m, roundLengthBelow_m, roundLengthText, shortText, shown, speedText } from '../ui/format';
import { boundIn, fromUnit, inUnit, provideUnits, shownText, siText, stepIn, unitText, type UnitChoice } from '../ui/units';

const use = (choice: UnitChoice): void => provideUnits(() => choice);
afterEach(() => use({}));

const CHOICES: readonly UnitChoice[] = [
  {},
  { height: 'ft', distance: 'ft', speed: 'mph', vertical_speed: 'ft/min' },
  { height: 'ft', distance: 'nmi', speed: 'kn', vertical_speed: 'ft/min' },
  { height: 'm', distance: 'm', speed: 'km/h', vertical_speed: 'm/s' },
];
const QUANTITIES = ['height', 'length', 'speed', 'climb', '°', ''];

describe('a typed value', () => {
  it('arrives in metres: 100 ft are 30.48 m', () => {
    use({ height: 'ft', speed: 'kn' });
    expect(siText('height', '100', '12')).toBe('30.48');
    expect(siText('height', '−3,5', '12')).toBe(String(-3.5 * 0.3048));
    expect(Number(siText('speed', '10', ''))).toBeCloseTo(5.14444, 5);
    expect([siText('height', '', '12'), siText('height', '12x', '12')]).toEqual(['', '12x']);
  });

  it('that was not changed stays exactly what it was, in every unit', () => {
    const random = seeded(1);
    for (const choice of CHOICES) {
      use(choice);
      for (let i = 0; i < 200; i++) {
        const before = String((random() - 0.5) * 10 ** Math.floor(random() * 6));
        for (const quantity of QUANTITIES) expect(siText(quantity, shownText(quantity, before), before)).toBe(before);
      }
    }
  });

  it('is shown again as it was typed, and is the same value in both directions', () => {
    const random = seeded(2);
    for (const choice of CHOICES) {
      use(choice);
      for (let i = 0; i < 200; i++) {
        const typed = String(Number(((random() - 0.5) * 10 ** Math.floor(random() * 5)).toFixed(2)));
        for (const quantity of QUANTITIES) {
          const si = siText(quantity, typed, 'none');
          expect(Number(shownText(quantity, si))).toBe(Number(typed));
          expect(inUnit(quantity, fromUnit(quantity, Number(typed)))).toBeCloseTo(Number(typed), 6);
        }
      }
    }
  });

  it('at a bound that is shown is accepted, beyond it is refused with the bound in the chosen unit', () => {
    for (const choice of CHOICES) {
      use(choice);
      for (const [model, field] of [
        ['TakeoffRequest', 'alt_home_m'],
        ['OrbitRequest', 'radius_m'],
        ['SpeedRequest', 'speed_m_s'],
        ['LimitsRequest', 'climb_max_m_s'],
      ] as const) {
        const { unit, min = 0, max = 0 } = quantityOf(field, boundsOf(model, field));
        const [least, most] = [boundIn(unit, min, 'up'), boundIn(unit, max, 'down')];
        for (const typed of [least, most]) expect(limitProblem(fromUnit(unit, typed), { min, max }, unit)).toBeNull();
        expect(limitProblem(fromUnit(unit, most + 0.02), { min, max }, unit)).toBe(`Enter a number from ${least} to ${most} ${unitText(unit)}.`);
      }
    }
  });

  it('is a height or a climb if its name says so', () => {
    use({ height: 'ft', distance: 'm', speed: 'kn', vertical_speed: 'ft/min' });
    const units = ['alt_home_m', 'height_max_m', 'radius_m', 'speed_m_s', 'climb_max_m_s', 'descent_m_s', 'yaw_ned_deg', 'duration_s'];
    expect(units.map((name) => unitText(quantityOf(name).unit))).toEqual(['ft', 'ft', 'm', 'kn', 'ft/min', 'ft/min', '°', 's']);
    expect(parseNumber('500', { max: 120 }, 'height')).toEqual({ ok: false, problem: 'Enter a number from -3280839895.01 to 393.7 ft.' });
  });

  it('steps by a round number of its unit', () => {
    expect([stepIn('height', 1), stepIn('speed', 0.5)]).toEqual([1, 0.5]);
    use({ height: 'ft', speed: 'km/h', vertical_speed: 'ft/min' });
    expect([stepIn('height', 1), stepIn('height', 0.5), stepIn('speed', 0.5), stepIn('climb', 0.5), stepIn('°', 5)]).toEqual([2, 2, 2, 100, 5]);
  });
});

describe('a shown value', () => {
  it('has its chosen unit', () => {
    use({ height: 'ft', distance: 'ft', speed: 'mph', vertical_speed: 'ft/min' });
    expect([heightText(12), speedText(10), shown('climb', 1).text]).toEqual(['39.4 ft', '22.4 mph', '197']);
    expect([distanceText(12), distanceText(400), distanceText(3000), areaText(50_000)]).toEqual(['39.4 ft', '1312 ft', '1.86 mi', '12.36 ac']);
    expect([shortText('height', 30.48), shortText('length', 1), heightText(null)]).toEqual(['100 ft', '3.3 ft', '– ft']);
    use({ height: 'm', distance: 'nmi' });
    expect([distanceText(400), distanceText(3000), shortText('length', 1)]).toEqual(['400 m', '1.62 nmi', '1 m']);
  });

  it('is unknown as before, and the SI unit without a choice', () => {
    expect([shown('height', null), shown('speed', NaN), heightText(12.34), speedText(3)]).toEqual([
      { text: '–', unit: 'm' },
      { text: '–', unit: 'm/s' },
      '12.3 m',
      '3.0 m/s',
    ]);
    use({ height: 'cubit' as 'm' }); // written by another version
    expect(heightText(1)).toBe('1.0 m');
  });

  it('has round scales and grids in its unit', () => {
    for (const [choice, below, above] of [
      [{}, ['20 m', '500 m', '10 km'], ['100 m', '1 km', '100 km']],
      [{ distance: 'ft' }, ['50 ft', '2000 ft', '5 mi'], ['100 ft', '1 mi', '10 mi']],
      [{ distance: 'nmi' }, ['20 m', '0.2 nmi', '5 nmi'], ['100 m', '1 nmi', '10 nmi']],
    ] as const) {
      use(choice);
      const lengths_m = [27, 700, 13_000];
      expect(lengths_m.map((length_m) => roundLengthText(roundLengthBelow_m(length_m)))).toEqual(below);
      expect(lengths_m.map((length_m) => roundLengthText(roundLengthAbove_m(length_m)))).toEqual(above);
    }
  });
});
