/** A dry run on the map and in words: the flown path, the corridor of many flights, the vehicle at one moment. Pure. */

import type { LayerPicture } from '../../app/map-layers.svelte';
import { duration, fixed, metres } from '../../ui/format';
import { placeAt, type Place } from '../../vehicle/geo';
import type { DryRunView } from './dry-run.svelte';

type Vector = readonly number[];

export interface Ghost extends Place {
  /** Above where it started. */
  readonly up_m: number;
  readonly speed_m_s: number;
  readonly step: string;
}

/** Where the vehicle is at a moment, between the samples; null: it never flew. */
export function ghostAt({ nominal }: DryRunView, t_s: number): Ghost | null {
  const { path, origin } = nominal;
  const last = (path?.t_s.length ?? 0) - 1;
  if (path === null || last < 0) return null;
  let [low, high] = [0, last];
  while (low < high) {
    const half = Math.ceil((low + high) / 2);
    if ((path.t_s[half] ?? 0) <= t_s) low = half;
    else high = half - 1;
  }
  const next = Math.min(low + 1, last);
  const [from_s, to_s] = [path.t_s[low] ?? 0, path.t_s[next] ?? 0];
  const share = to_s > from_s ? Math.min(1, Math.max(0, (t_s - from_s) / (to_s - from_s))) : 0;
  const [a, b] = [(path.position_ned_m[low] ?? []) as Vector, (path.position_ned_m[next] ?? []) as Vector];
  const at = (axis: number): number => (a[axis] ?? 0) + share * ((b[axis] ?? 0) - (a[axis] ?? 0));
  return {
    ...placeAt(origin, { north_m: at(0), east_m: at(1) }),
    up_m: -at(2) + 0,
    speed_m_s: Math.hypot(...((path.velocity_ned_m_s[low] ?? []) as Vector)),
    step: path.step_places[path.step[low] ?? -1] ?? '',
  };
}

/** The 95th percentile over the ground, to both sides of the path. */
function corridorRing({ nominal, monte_carlo }: DryRunView): Place[] {
  const corridor = monte_carlo?.corridor;
  if (corridor == null) return [];
  const places = corridor.position_ned_m as readonly Vector[];
  const sides: { left: Place; right: Place }[] = [];
  places.forEach((here, i) => {
    const [before, after] = [places[Math.max(0, i - 1)] ?? here, places[Math.min(places.length - 1, i + 1)] ?? here];
    const [north, east] = [(after[0] ?? 0) - (before[0] ?? 0), (after[1] ?? 0) - (before[1] ?? 0)];
    const length = Math.hypot(north, east);
    if (length < 0.01) return;
    const off_m = corridor.horizontal_m.p95[i] ?? 0;
    const side = (sign: number): Place =>
      placeAt(nominal.origin, { north_m: (here[0] ?? 0) - (sign * off_m * east) / length, east_m: (here[1] ?? 0) + (sign * off_m * north) / length });
    sides.push({ left: side(-1), right: side(1) });
  });
  return [...sides.map(({ left }) => left), ...sides.reverse().map(({ right }) => right)];
}

export function dryRunPicture(view: DryRunView, t_s: number): LayerPicture {
  const flown = (view.nominal.path?.position_ned_m ?? []) as readonly Vector[];
  const places = flown.map(([north_m = 0, east_m = 0]) => placeAt(view.nominal.origin, { north_m, east_m }));
  const ring = corridorRing(view);
  const ghost = ghostAt(view, t_s);
  return {
    lines: places.length > 1 ? [{ places, tone: 'actual', style: 'dotted' }] : [],
    areas: ring.length > 2 ? [{ ring, tone: 'actual' }] : [],
    points: ghost === null ? [] : [{ id: 'ghost', lat_deg: ghost.lat_deg, lon_deg: ghost.lon_deg, mark: 'disc', tone: 'actual', text: '', selected: true }],
  };
}

const percent = (share: number | null): string => (share === null ? 'not known' : `${fixed(100 * share, 0)} %`);

/** The result in numbers, as sentences. */
export function resultLines({ nominal, monte_carlo: many }: DryRunView): string[] {
  const length = metres(nominal.length_m);
  const battery = `battery ${percent(nominal.battery_start_share)} → ${percent(nominal.battery_end_share)}`;
  const lines = [`${nominal.finished ? 'Flown' : 'Not flown to its end'}: ${duration(nominal.duration_s)}, ${length.text} ${length.unit}, ${battery}.`];
  if (nominal.fence_distance_m !== null) lines.push(`Distance to the geofence: at least ${fixed(nominal.fence_distance_m, 1)} m.`);
  if (many === null) return lines;
  const parts = [`95 % within ${fixed(Math.max(0, ...(many.corridor?.horizontal_m.p95 ?? [])), 1)} m of the path`];
  if (many.duration_s !== null) parts.push(`${duration(many.duration_s.p5)} to ${duration(many.duration_s.p95)}`);
  if (many.battery_end_share !== null) parts.push(`battery at the end ${percent(many.battery_end_share.p5)} or more`);
  lines.push(`${many.flights.length} flights: ${parts.join(', ')}.`);
  return lines;
}
