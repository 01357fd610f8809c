/** Wind, mass, battery and similar conditions of a flight, for the dry run and for the estimates. Pure functions. */

import type { components } from '../../../api/schema';

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

export interface ConditionRow {
  readonly name: keyof Conditions;
  readonly label: string;
  readonly unit: string;
  readonly min: number;
  readonly max: number;
  readonly step?: number;
  /** The field may be empty. */
  readonly optional?: boolean;
}

/** The rows of the form except `SPREAD_ROWS`. Their bounds are those of the server. */
export const CONDITION_ROWS: readonly ConditionRow[] = [
  { name: 'wind_m_s', label: 'Wind', unit: 'm/s', min: 0, max: 30 },
  { name: 'from_deg', label: 'Wind from', unit: '°', min: 0, max: 360, step: 10 },
  { name: 'gusts_m_s', label: 'Gusts (one sigma)', unit: 'm/s', min: 0, max: 20, step: 0.5 },
  { name: 'mass_percent', label: 'Mass scale', unit: '%', min: 30, max: 300, step: 5 },
  { name: 'battery_percent', label: 'Battery capacity scale', unit: '%', min: 5, max: 300, step: 5 },
  { name: 'noise_percent', label: 'Sensor noise scale', unit: '%', min: 0, max: 1000, step: 10 },
  { name: 'flights', label: 'Flights with varied conditions (0: none)', unit: '', min: 0, max: 200, step: 10 },
  { name: 'hover_power_w', label: 'Hover power', unit: 'W', min: 1, max: 1e6, step: 10, optional: true },
  { name: 'battery_wh', label: 'Battery capacity', unit: 'Wh', min: 1, max: 1e6, step: 5, optional: true },
  { name: 'mass_kg', label: 'Mass with battery and load', unit: 'kg', min: 0.01, max: 1e4, step: 0.1, optional: true },
  { name: 'reserve_percent', label: 'Battery reserve', unit: '%', min: 0, max: 95, step: 5 },
];

/** The first row of `CONDITION_ROWS` with data of the vehicle; the earlier rows contain the simulated conditions. */
export const FIRST_VEHICLE_ROW = 'hover_power_w';

/** The rows for the variation of each condition (1 σ) in Monte Carlo flights. Their bounds are those of the server. */
export const SPREAD_ROWS: readonly ConditionRow[] = [
  { name: 'spread_wind_m_s', label: 'Wind varies by', unit: 'm/s', min: 0, max: 10, step: 0.5 },
  { name: 'spread_gusts_percent', label: 'Gusts vary by', unit: '%', min: 0, max: 50, step: 5 },
  { name: 'spread_mass_percent', label: 'Mass varies by', unit: '%', min: 0, max: 50 },
  { name: 'spread_battery_percent', label: 'Battery capacity varies by', unit: '%', min: 0, max: 50 },
  { name: 'spread_noise_percent', label: 'Sensor noise varies by', unit: '%', min: 0, max: 50, step: 5 },
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
  if (wind_m_s > 0) parts.push(`wind ${wind_m_s} m/s from ${from_deg}°`);
  if (gusts_m_s > 0) parts.push(`gusts ${gusts_m_s} m/s (one sigma)`);
  if (mass_percent !== 100) parts.push(`mass ${mass_percent} %`);
  if (battery_percent !== 100) parts.push(`battery capacity ${battery_percent} %`);
  if (noise_percent !== 100) parts.push(`sensor noise ${noise_percent} %`);
  if (flights > 0) parts.push(`${flights} flights`);
  return parts.length === 0 ? '' : `Conditions: ${parts.join(', ')}.`;
}
