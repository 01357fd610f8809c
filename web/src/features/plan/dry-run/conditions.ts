/** Wind, mass, battery and similar conditions of a flight, for the dry run and for the estimates. Pure functions. */

import { shortText } from '../../../ui/format';
import type { components } from '../../../api/schema';
import { boundsOf, inPercent, quantityOf, type Limits } from '../../../vehicle/fields';

type Schemas = components['schemas'];
export type Power = Schemas['Power'];

export interface Conditions {
  readonly wind_m_s: number;
  /** Direction that the wind comes from, clockwise from north. */
  readonly from_deg: number;
  /** Standard deviation (1 σ). */
  readonly gusts_m_s: number;
  /** 100: the mass of the simulated airframe. */
  readonly mass_percent: number;
  /** Scale of the battery's capacity; 100: the capacity of the simulator's model. */
  readonly battery_percent: number;
  /** 100: the sensor noise of the simulator's model. */
  readonly noise_percent: number;
  /** Number of Monte Carlo flights; 0: one flight under exactly these conditions. */
  readonly flights: number;
  /** The fields `spread_…`: variation of a condition between the Monte Carlo flights (1 σ). The wind varies on each axis. */
  readonly spread_wind_m_s: number;
  readonly spread_gusts_percent: number;
  readonly spread_mass_percent: number;
  readonly spread_battery_percent: number;
  readonly spread_noise_percent: number;
  /** `hover_power_w`, `battery_wh` and `mass_kg`: data of the real vehicle; null: not known. */
  readonly hover_power_w: number | null;
  readonly battery_wh: number | null;
  readonly mass_kg: number | null;
  /** Battery charge that must remain at the end. */
  readonly reserve_percent: number;
}

export const DEFAULT_CONDITIONS: Conditions = {
  wind_m_s: 0,
  from_deg: 0,
  gusts_m_s: 0,
  mass_percent: 100,
  battery_percent: 100,
  noise_percent: 100,
  flights: 0,
  spread_wind_m_s: 1.5,
  spread_gusts_percent: 30,
  spread_mass_percent: 3,
  spread_battery_percent: 5,
  spread_noise_percent: 20,
  hover_power_w: null,
  battery_wh: null,
  mass_kg: null,
  reserve_percent: 20,
};

export interface ConditionRow extends Limits {
  readonly name: keyof Conditions;
  readonly label: string;
  readonly unit: string;
  readonly step: number;
  /** The field may be empty. */
  readonly optional?: boolean;
}

type RowDetails = Partial<Omit<ConditionRow, 'name' | 'label'>>;
/** @param model the API's model with the bounds. @param field the field's name there. */
function conditionRow(name: keyof Conditions, label: string, model: string, field: string, details: RowDetails = {}): ConditionRow {
  const limits = boundsOf(model, field);
  const { scale: _, ...quantity } = quantityOf(name, name.endsWith('_percent') ? inPercent(limits) : limits);
  return { name, label, ...quantity, ...details };
}

/** The rows of the form except `SPREAD_ROWS`. */
export const CONDITION_ROWS: readonly ConditionRow[] = [
  { name: 'wind_m_s', label: 'Wind', unit: 'speed', step: 1, min: 0, max: 30 }, // the API limits the vector
  { name: 'from_deg', label: 'Wind from', unit: '°', step: 10, min: 0, max: 360 },
  conditionRow('gusts_m_s', 'Gusts (one sigma)', 'DryRunConditions', 'gusts_m_s'),
  conditionRow('mass_percent', 'Mass scale', 'DryRunConditions', 'mass_scale', { step: 5 }),
  conditionRow('battery_percent', 'Battery capacity scale', 'DryRunConditions', 'battery_scale', { step: 5 }),
  conditionRow('noise_percent', 'Sensor noise scale', 'DryRunConditions', 'sensor_noise', { step: 10 }),
  conditionRow('flights', 'Flights with varied conditions (0: none)', 'DryRunRequest', 'flights', { min: 0, step: 10 }),
  conditionRow('hover_power_w', 'Hover power', 'Power', 'hover_power_w', { optional: true }),
  conditionRow('battery_wh', 'Battery capacity', 'Power', 'battery_wh', { optional: true }),
  conditionRow('mass_kg', 'Mass with battery and load', 'Power', 'mass_kg', { optional: true }),
  conditionRow('reserve_percent', 'Battery reserve', 'DryRunRequest', 'battery_reserve', { step: 5 }),
];

/** The first row of `CONDITION_ROWS` with data of the vehicle; the earlier rows contain the simulated conditions. */
export const FIRST_VEHICLE_ROW = 'hover_power_w';

/** The rows for the variation of each condition (1 σ) in Monte Carlo flights. */
export const SPREAD_ROWS: readonly ConditionRow[] = [
  conditionRow('spread_wind_m_s', 'Wind varies by', 'DryRunSpread', 'wind_m_s'),
  conditionRow('spread_gusts_percent', 'Gusts vary by', 'DryRunSpread', 'gusts', { step: 5 }),
  conditionRow('spread_mass_percent', 'Mass varies by', 'DryRunSpread', 'mass'),
  conditionRow('spread_battery_percent', 'Battery capacity varies by', 'DryRunSpread', 'battery'),
  conditionRow('spread_noise_percent', 'Sensor noise varies by', 'DryRunSpread', 'sensor_noise', { step: 5 }),
];

/** The conditions with one value changed. An empty value is ignored unless the row is optional. */
export function withCondition(conditions: Conditions, { name, optional }: ConditionRow, value: number | null): Conditions {
  if (value === null && optional !== true) return conditions;
  return { ...conditions, [name]: name === 'flights' && value !== null ? Math.round(value) : value };
}

/** Wind velocity north, east and down [m/s]. The added 0 converts −0 to 0. */
export function windOf({ wind_m_s, from_deg }: Conditions): [number, number, number] {
  const from_rad = (from_deg * Math.PI) / 180;
  return [-wind_m_s * Math.cos(from_rad) + 0, -wind_m_s * Math.sin(from_rad) + 0, 0];
}

/** Values for the energy estimate; null: power, capacity or mass is not known, so there is no estimate. */
export function powerOf({ hover_power_w, battery_wh, mass_kg, reserve_percent }: Conditions): Power | null {
  if (hover_power_w === null || battery_wh === null || mass_kg === null) return null;
  return { hover_power_w, battery_wh, mass_kg, reserve: reserve_percent / 100 };
}

/** The conditions in the format of the API's dry run. */
export function toDryRunRequest(conditions: Conditions) {
  const { flights, hover_power_w, battery_wh } = conditions;
  return {
    conditions: {
      wind_ned_m_s: windOf(conditions),
      gusts_m_s: conditions.gusts_m_s,
      mass_scale: conditions.mass_percent / 100,
      battery_scale: conditions.battery_percent / 100,
      sensor_noise: conditions.noise_percent / 100,
    },
    spread: {
      wind_m_s: conditions.spread_wind_m_s,
      gusts: conditions.spread_gusts_percent / 100,
      mass: conditions.spread_mass_percent / 100,
      battery: conditions.spread_battery_percent / 100,
      sensor_noise: conditions.spread_noise_percent / 100,
    },
    flights: flights === 0 ? null : flights,
    endurance_s: hover_power_w === null || battery_wh === null ? null : Math.min(100_000, (battery_wh / hover_power_w) * 3600),
    battery_reserve: conditions.reserve_percent / 100,
  };
}

/** Text about the simulated conditions that differ from the defaults; empty if there are none. */
export function conditionsText(conditions: Conditions): string {
  const parts: string[] = [];
  const { wind_m_s, from_deg, gusts_m_s, mass_percent, battery_percent, noise_percent, flights } = conditions;
  if (wind_m_s > 0) parts.push(`wind ${shortText('speed', wind_m_s)} from ${from_deg}°`);
  if (gusts_m_s > 0) parts.push(`gusts ${shortText('speed', gusts_m_s)} (one sigma)`);
  if (mass_percent !== 100) parts.push(`mass ${mass_percent} %`);
  if (battery_percent !== 100) parts.push(`battery capacity ${battery_percent} %`);
  if (noise_percent !== 100) parts.push(`sensor noise ${noise_percent} %`);
  if (flights > 0) parts.push(`${flights} flights`);
  return parts.length === 0 ? '' : `Conditions: ${parts.join(', ')}.`;
}
