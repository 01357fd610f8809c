/** Texts and rows about why a vehicle cannot be armed or fly in a mode, from the server's topic `readiness`. Pure functions. */

import type { components } from '../../api/schema';
import type { SeverityName } from '../../ui/severity';

export type Readiness = Omit<components['schemas']['VehicleReadiness'], 'vehicle'>;
export type Cause = components['schemas']['ReadinessCause'];
export type ModeReadiness = components['schemas']['ModeReadiness'];

export interface Headline {
  text: string;
  /** Causes of the blocking findings. */
  detail: string;
  tone: 'ok' | 'caution' | 'neutral';
}

export interface FindingRow {
  cause: Cause;
  severity: SeverityName;
  /** Names of the modes that the finding blocks; empty: none. */
  blockedModes: string;
}

export interface ModeRow {
  mode: string;
  label: string;
  isCurrent: boolean;
  can_arm: boolean;
  can_run: boolean;
  /** Why arming or flying is not possible; empty: both are possible. */
  reason: string;
}

/** Names of PX4's health components, by their names in the API. */
export const COMPONENT_NAMES: Readonly<Record<string, string>> = {
  barometer: 'barometer',
  'airspeed sensor': 'airspeed sensor',
  GPS: 'GPS',
  'optical flow': 'optical flow',
  vision: 'vision',
  'distance sensor': 'distance sensor',
  transmitter: 'transmitter',
  motors: 'motors',
  'traffic management': 'traffic management',
  logging: 'logging',
  battery: 'battery',
  links: 'links',
  'rate control': 'rate control',
  'attitude control': 'attitude control',
  'position control': 'position control',
  'attitude estimate': 'attitude estimate',
  'position estimate': 'position estimate',
  mission: 'mission',
  'obstacle avoidance': 'obstacle avoidance',
  system: 'system',
  camera: 'camera',
  gimbal: 'gimbal',
  payload: 'payload',
  'global position': 'global position',
  storage: 'storage',
  parachute: 'parachute',
  compass: 'compass',
  accelerometer: 'accelerometer',
  gyro: 'gyro',
};
const INFO: SeverityName = { label: '', fullName: 'Note', tone: 'dim', shape: 'dot' };
const SEVERITIES: Readonly<Record<string, SeverityName>> = {
  error: { label: 'Error', fullName: 'Error', tone: 'danger', shape: 'square' },
  warning: { label: 'Warning', fullName: 'Warning', tone: 'caution', shape: 'triangle' },
  info: INFO,
};
/** Maximum number of listed mode names; the others are counted. */
const MAX_NAMES = 4;

/** Reads a sample of the topic; null if it has another format. */
export function readReadiness(value: unknown): Readiness | null {
  const report = value as Readiness | null | undefined;
  return typeof report === 'object' && report !== null && Array.isArray(report.modes) && Array.isArray(report.findings) ? report : null;
}

/** For a disarmed vehicle: whether it can be armed in its current mode. For an armed vehicle: whether it can fly in this mode. */
export function headline(readiness: Readiness | null, mode: string | null, armed: boolean): Headline {
  if (readiness === null || !readiness.known) return { text: 'Readiness not known', detail: 'The vehicle has not reported its checks.', tone: 'neutral' };
  const current = readiness.modes.find((m) => m.mode === mode);
  if (current === undefined) return { text: 'Readiness not known', detail: 'The vehicle’s checks do not cover the current mode.', tone: 'neutral' };
  const isBlocked = armed ? !current.can_run : !current.can_arm;
  if (!isBlocked) return { text: armed ? `${current.label} mode is available` : `Ready to arm in ${current.label}`, detail: '', tone: 'ok' };
  const causes = (armed ? current.running : current.arming).map((c) => c.cause).join(' ');
  return { text: armed ? `${current.label} mode is not available` : `Cannot arm in ${current.label}`, detail: causes, tone: 'caution' };
}

/** All findings: first the findings that block a mode, then the others; each part sorted by severity. */
export function findings(readiness: Readiness): FindingRow[] {
  const rows = readiness.findings.map((cause) => ({ cause, severity: SEVERITIES[cause.severity] ?? INFO, modes: modesBlockedBy(readiness, cause) }));
  const rank = { error: 0, warning: 1, info: 2 } as Readonly<Record<string, number>>;
  rows.sort((a, b) => Number(b.modes.length > 0) - Number(a.modes.length > 0) || (rank[a.cause.severity] ?? 3) - (rank[b.cause.severity] ?? 3));
  return rows.map(({ cause, severity, modes }) => ({ cause, severity, blockedModes: namesOf(modes, readiness.modes.length) }));
}

function modesBlockedBy(readiness: Readiness, cause: Cause): ModeReadiness[] {
  const isSame = (other: Cause): boolean => other.id === cause.id && other.cause === cause.cause;
  return readiness.modes.filter((m) => m.arming.some(isSame) || m.running.some(isSame));
}

function namesOf(modes: readonly ModeReadiness[], modeCount: number): string {
  if (modes.length === 0) return '';
  if (modes.length === modeCount) return 'every mode';
  const names = modes
    .slice(0, MAX_NAMES)
    .map((m) => m.label)
    .join(', ');
  return modes.length > MAX_NAMES ? `${names} and ${modes.length - MAX_NAMES} more` : names;
}

/** All modes: the current mode, then the modes in which the vehicle can be armed and can fly, then the others. */
export function modeRows(readiness: Readiness, mode: string | null): ModeRow[] {
  const rows = readiness.modes.map((m) => ({
    mode: m.mode,
    label: m.label,
    isCurrent: m.mode === mode,
    can_arm: m.can_arm,
    can_run: m.can_run,
    reason: [...new Set([...m.arming, ...m.running].map((c) => c.cause))].join(' '),
  }));
  return rows.sort((a, b) => Number(b.isCurrent) - Number(a.isCurrent) || possibleCount(b) - possibleCount(a));
}

/** How many of arming and flying are possible. */
function possibleCount(row: ModeRow): number {
  return Number(row.can_arm) + Number(row.can_run);
}
