/** A flight of a waypoint plan, which PX4 flies and the server monitors, as texts and numbers. Pure functions. */

import type { components } from '../../../api/schema';
import { duration, fixed } from '../../../ui/format';
import { isSameStart, type GeoPosition } from '../../../vehicle/geo';
import type { DryRunResult } from '../dry-run/dry-run.svelte';

/** `planned_by` is the source of the planned path and times: `plan` for estimates from the plan's straight lines, or `dry_run`. */
export type WaypointFlight = Readonly<components['schemas']['WaypointFlightStatus']>;

const LABELS: Readonly<Record<WaypointFlight['state'], { text: string; tone: 'ok' | 'target' | 'caution' | 'dim' }>> = {
  flying: { text: 'Flying', tone: 'target' },
  paused: { text: 'Paused: not in Mission mode', tone: 'dim' },
  done: { text: 'Done', tone: 'ok' },
  stopped: { text: 'Ended early', tone: 'caution' },
};

export function flightLabel(flight: WaypointFlight): (typeof LABELS)[WaypointFlight['state']] {
  return LABELS[flight.state];
}

export function hasEnded(flight: WaypointFlight): boolean {
  return flight.state === 'done' || flight.state === 'stopped';
}

/** Elapsed part of the planned time, 0 to 1; null: not known. */
export function flightProgress({ duration_s, remaining_s }: WaypointFlight): number | null {
  if (duration_s === null || remaining_s === null || !(duration_s > 0)) return null;
  return Math.min(1, Math.max(0, 1 - remaining_s / duration_s));
}

/** Remaining time and deviation in one line; null: neither is known. */
export function flightText(flight: WaypointFlight): string | null {
  const remainingTime = flight.remaining_s === null ? null : `${flight.planned_by === 'plan' ? 'about ' : ''}${duration(flight.remaining_s)} remaining`;
  const parts = [remainingTime, deviationText(flight)].filter((part) => part !== null);
  return parts.length === 0 ? null : parts.join(' · ');
}

function deviationText({ deviation_horizontal_m: horizontal_m, deviation_vertical_m: up_m, planned_by }: WaypointFlight): string | null {
  if (horizontal_m === null || up_m === null) return null;
  const path = planned_by === 'dry_run' ? 'the path of the dry run' : 'the straight lines of the plan';
  return `${fixed(horizontal_m, 1)} m beside and ${fixed(Math.abs(up_m), 1)} m ${up_m < 0 ? 'below' : 'above'} ${path}`;
}

/**
 * Id of the dry run to compare a flight with: a completed dry run of this vehicle from the same start; null: none.
 * @param position position of the vehicle on the ground.
 */
export function dryRunIdFor(result: DryRunResult | null, vehicle: string, position: GeoPosition | null): string | null {
  if (result === null || result.vehicle !== vehicle || !result.nominal.finished || position === null) return null;
  return isSameStart(position, result.nominal.origin) ? result.id : null;
}
