/** Why a vehicle cannot arm or fly, sorted for display, from the server's topic `readiness`. Pure. */

import type { components } from '../../api/schema';
import type { SeverityName } from '../../ui/severity';

export type Readiness = Omit<components['schemas']['VehicleReadiness'], 'vehicle'>;
export type Cause = components['schemas']['ReadinessCause'];
export type ModeReadiness = components['schemas']['ModeReadiness'];

export interface Headline {
  text: string;
  /** The blocking findings, in a few words. */
  detail: string;
  tone: 'ok' | 'caution' | 'neutral';
}

export interface FindingRow {
  cause: Cause;
  severity: SeverityName;
  /** What the finding blocks, as text; empty if nothing. */
  blocks: string;
}

export interface ModeRow {
  mode: string;
  label: string;
  current: boolean;
  can_arm: boolean;
  can_run: boolean;
  /** Short reason; empty if the mode is possible. */
  why: string;
}

const INFO: SeverityName = { word: '', full: 'Note', tone: 'dim', shape: 'dot' };
const SEVERITIES: Readonly<Record<string, SeverityName>> = {
  error: { word: 'Error', full: 'Error', tone: 'danger', shape: 'square' },
  warning: { word: 'Warning', full: 'Warning', tone: 'caution', shape: 'triangle' },
  info: INFO,
};
/** Above this number, names are counted instead of listed. */
const NAMED = 4;

/** Reads a sample of the topic; null if it has another format. */
export function readReadiness(value: unknown): Readiness | null {
  const report = value as Readiness | null | undefined;
  return typeof report === 'object' && report !== null && Array.isArray(report.modes) && Array.isArray(report.findings) ? report : null;
}

/** Whether the vehicle can be armed in the current mode (while disarmed) or can fly in it (while armed). */
export function headline(readiness: Readiness | null, mode: string | null, armed: boolean): Headline {
  if (readiness === null || !readiness.known) return { text: 'Not known', detail: 'The vehicle has not reported its checks.', tone: 'neutral' };
  const now = readiness.modes.find((m) => m.mode === mode);
  if (now === undefined) return { text: 'Not known', detail: 'The vehicle’s checks do not cover the current mode.', tone: 'neutral' };
  const blocked = armed ? !now.can_run : !now.can_arm;
  if (!blocked) return { text: armed ? `${now.label} can be flown` : `Ready to arm in ${now.label}`, detail: '', tone: 'ok' };
  const causes = (armed ? now.running : now.arming).map((c) => c.cause).join(' ');
  return { text: armed ? `${now.label} cannot be flown` : `Cannot arm in ${now.label}`, detail: causes, tone: 'caution' };
}

/** All findings of the checks, the most blocking first. */
export function findings(readiness: Readiness): FindingRow[] {
  const rows = readiness.findings.map((cause) => ({ cause, severity: SEVERITIES[cause.severity] ?? INFO, blocked: blockedBy(readiness, cause) }));
  const rank = { error: 0, warning: 1, info: 2 } as Readonly<Record<string, number>>;
  rows.sort((a, b) => Number(b.blocked.length > 0) - Number(a.blocked.length > 0) || (rank[a.cause.severity] ?? 3) - (rank[b.cause.severity] ?? 3));
  return rows.map(({ cause, severity, blocked }) => ({ cause, severity, blocks: namesOf(blocked, readiness.modes.length) }));
}

function blockedBy(readiness: Readiness, cause: Cause): ModeReadiness[] {
  const same = (other: Cause): boolean => other.id === cause.id && other.cause === cause.cause;
  return readiness.modes.filter((m) => m.arming.some(same) || m.running.some(same));
}

function namesOf(modes: readonly ModeReadiness[], all: number): string {
  if (modes.length === 0) return '';
  if (modes.length === all) return 'every mode';
  const names = modes
    .slice(0, NAMED)
    .map((m) => m.label)
    .join(', ');
  return modes.length > NAMED ? `${names} and ${modes.length - NAMED} more` : names;
}

/** All modes, the possible ones first. */
export function modeRows(readiness: Readiness, mode: string | null): ModeRow[] {
  const rows = readiness.modes.map((m) => ({
    mode: m.mode,
    label: m.label,
    current: m.mode === mode,
    can_arm: m.can_arm,
    can_run: m.can_run,
    why: [...new Set([...m.arming, ...m.running].map((c) => c.cause))].join(' '),
  }));
  return rows.sort((a, b) => Number(b.current) - Number(a.current) || possibleCount(b) - possibleCount(a));
}

function possibleCount(row: ModeRow): number {
  return Number(row.can_arm) + Number(row.can_run);
}
