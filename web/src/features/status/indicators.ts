/** The indicators of GPS, battery and link: a short text each, with a severity and a word for the problem. */

import { fixed, join, lengthText, UNKNOWN } from '../../ui/format';
import { ageText } from '../../live/age';
import type { Battery, Component, Gps } from '../../live/topics';
import type { Reading } from '../../live/vehicle-state';

export type Severity = 'none' | 'caution' | 'danger';

export interface Indicator {
  label: string;
  text: string;
  /** The problem in a few words; empty: no problem. */
  problem: string;
  severity: Severity;
  stale: boolean;
  age_s: number | null;
  details: [string, string][];
}

/** By the component's kind in the API. */
const COMPONENT_NAMES: Readonly<Record<string, string>> = {
  gimbal: 'Gimbal',
  camera: 'Camera',
  companion: 'Companion computer',
  'ground station': 'Ground station',
};
const CONNECTED_TEXT = 'connected';
const WEAK_TEXT = 'weak';

/** Packet loss above which the link is shown as weak [%]. */
const WEAK_PERCENT = 5;
/** Texts by MAVLink's GPS_FIX_TYPE. */
const FIX_TEXTS = ['no GPS', 'no fix', '2D fix', '3D fix', 'DGPS', 'RTK float', 'RTK fixed'];

function emptyIndicator(label: string): Indicator {
  return { label, text: UNKNOWN, problem: '', severity: 'none', stale: false, age_s: null, details: [['', 'Nothing received yet.']] };
}

export function gpsIndicator(reading: Reading<Gps> | null): Indicator {
  if (reading === null) return emptyIndicator('GPS');
  const { value: gps, stale, age_s } = reading;
  const fix = FIX_TEXTS[gps.fix_type] ?? `fix ${gps.fix_type}`;
  const satellites = gps.satellites === null ? null : `${gps.satellites} sats`;
  const accuracy = gps.horizontal_accuracy_m === null ? null : `±${lengthText(gps.horizontal_accuracy_m)}`;
  const lacks3dFix = gps.fix_type < 3;
  return {
    label: 'GPS',
    stale,
    age_s,
    text: lacks3dFix ? (satellites ?? UNKNOWN) : join([satellites, accuracy ?? fix]),
    problem: lacks3dFix ? fix : '',
    severity: lacks3dFix ? 'danger' : 'none',
    details: [
      ['Fix', fix],
      ['Satellites', gps.satellites === null ? UNKNOWN : String(gps.satellites)],
      ['HDOP', fixed(gps.hdop, 2)],
      ['Accuracy (eph)', accuracy === null ? UNKNOWN : `${accuracy} horizontal`],
      ['Last received', `${fixed(age_s, 1)} s ago`],
    ],
  };
}

/** The cell with the lowest voltage, which limits the battery, and the voltages of all cells. */
function cellLines(cells_v: readonly number[] | null): [string, string][] {
  if (cells_v === null || cells_v.length === 0) return [['Cells', UNKNOWN]];
  const lowest_v = Math.min(...cells_v);
  return [
    ['Lowest cell', `${fixed(lowest_v, 2)} V, cell ${cells_v.indexOf(lowest_v) + 1} of ${cells_v.length}`],
    ['Cells', cells_v.map((v) => fixed(v, 2)).join(' · ')],
  ];
}

/** One line for each battery; the topic lists the batteries only if there are several. */
function batteryLines(batteries: Battery['batteries'] | undefined): [string, string][] {
  return (batteries ?? []).map((battery) => [
    `Battery ${battery.battery_id + 1}`,
    join([
      battery.remaining_percent === null ? null : `${battery.remaining_percent} %`,
      battery.voltage_v === null ? null : `${fixed(battery.voltage_v, 2)} V`,
      battery.current_a === null ? null : `${fixed(battery.current_a, 1)} A`,
    ]),
  ]);
}

export function batteryIndicator(reading: Reading<Battery> | null): Indicator {
  if (reading === null) return emptyIndicator('Battery');
  const { value: battery, stale, age_s } = reading;
  const percent = battery.remaining_percent;
  const severity: Severity = percent === null ? 'none' : percent <= 10 ? 'danger' : percent <= 25 ? 'caution' : 'none';
  const volts = battery.voltage_v === null ? null : `${fixed(battery.voltage_v, 1)} V`;
  const timeLeft_s = battery.time_remaining_s;
  return {
    label: 'Battery',
    stale,
    age_s,
    severity,
    text: join([percent === null ? null : `${percent} %`, volts]),
    problem: severity === 'danger' ? '≤ 10 %' : severity === 'caution' ? '≤ 25 %' : '',
    details: [
      ['Remaining', percent === null ? UNKNOWN : `${percent} %`],
      ['Voltage', battery.voltage_v === null ? UNKNOWN : `${fixed(battery.voltage_v, 2)} V`],
      ['Current', battery.current_a === null ? UNKNOWN : `${fixed(battery.current_a, 1)} A`],
      ['Consumed', battery.consumed_mah === null ? UNKNOWN : `${battery.consumed_mah} mAh`],
      ['Time left', timeLeft_s === null || timeLeft_s <= 0 ? UNKNOWN : `${Math.round(timeLeft_s / 60)} min`],
      ...cellLines(battery.cell_voltages_v),
      ...batteryLines(battery.batteries),
    ],
  };
}

/** One line for each component other than the autopilot. */
export function componentLines(components: readonly Component[], now_unix_s: number): [string, string][] {
  return components
    .filter((component) => component.kind !== 'autopilot')
    .map((component) => [
      `${COMPONENT_NAMES[component.kind] ?? 'Component'} ${component.component_id}`,
      !component.lost
        ? CONNECTED_TEXT
        : component.last_heard_unix_s === null
          ? 'connection lost'
          : `connection lost ${ageText(now_unix_s - component.last_heard_unix_s)} ago`,
    ]);
}

/**
 * The state of the vehicle's link, from the age of the vehicle's last heartbeat.
 * @param details lines with the server's counters.
 * @param text state and rates of the server's open links; null: no open link.
 * @param offline the page has no connection to the server.
 */
export function linkIndicator(
  heartbeatAge_s: number | null,
  lost: boolean,
  details: [string, string][],
  text: string | null,
  lost_percent: number | null = null,
  offline = false,
): Indicator {
  if (offline)
    return {
      ...emptyIndicator('Link'),
      text: 'unknown',
      problem: 'no server',
      severity: 'danger',
      details: [['', 'This page has no connection to the server: the state of the vehicle’s link is not known.']],
    };
  if (heartbeatAge_s === null) return { ...emptyIndicator('Link'), details };
  const isWeak = !lost && lost_percent !== null && lost_percent > WEAK_PERCENT;
  return {
    label: 'Link',
    stale: false,
    age_s: heartbeatAge_s,
    text: lost ? `lost ${Math.round(heartbeatAge_s)} s ago` : (text ?? CONNECTED_TEXT),
    problem: isWeak ? WEAK_TEXT : '',
    severity: lost ? 'danger' : isWeak ? 'caution' : 'none',
    details: [['Last heartbeat', `${fixed(heartbeatAge_s, 1)} s ago`], ...details],
  };
}
