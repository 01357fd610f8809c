/** The futures of a command as a line of text and as a layer of the map. Pure functions. */

import type { components } from '../../api/schema';
import { durationText, fixed, lengthText } from '../../ui/format';
import { positionAt, type GeoPosition } from '../../vehicle/geo';
import { corridorRings } from '../corridor';
import type { LayerContent, LayerLine, LayerPosition } from '../map-layers.svelte';

type Schemas = components['schemas'];
export type FuturesBody = Schemas['FuturesRequest'];
export type Futures = Schemas['Futures'];
type Nearest = NonNullable<Futures['fence']>;

export interface FuturesTexts {
  /** What goes wrong in a flight; empty: nothing. */
  readonly dangers: readonly string[];
  /** Time, battery and distances. */
  readonly facts: string;
  /** What was not known. */
  readonly assumed: readonly string[];
}

const DISC_POINTS = 24;

/** The nearest thing of a kind, as a text. */
function nearestText(name: string, { distance_m, t_s }: Nearest): string {
  return `${name} ${lengthText(distance_m)} after ${durationText(t_s)}`;
}

/** What a flight comes to, as texts. @param nameOf name of a vehicle by its id. */
export function futuresTexts(result: Futures, nameOf: (id: string) => string): FuturesTexts {
  const { flights, fence, obstacle, vehicle, arrival_s, battery_end_share: battery } = result;
  const of = (count: number): string => `in ${count} of ${flights} simulated flights`;
  const dangers: string[] = [];
  if (result.lost_control > 0) dangers.push(`Loses control ${of(result.lost_control)}.`);
  if (result.touched_ground > 0) dangers.push(`Touches the ground ${of(result.touched_ground)}.`);
  if (fence !== null && fence.touched > 0)
    dangers.push(`Leaves the geofence ${of(fence.touched)}, by up to ${lengthText(-fence.distance_m)}, after ${durationText(fence.t_s)}.`);
  if (obstacle !== null && obstacle.touched > 0) dangers.push(`Touches ${obstacle.name} ${of(obstacle.touched)}, after ${durationText(obstacle.t_s)}.`);
  if (vehicle !== null && vehicle.touched > 0)
    dangers.push(`Comes within ${lengthText(vehicle.distance_m)} of ${nameOf(vehicle.name)} ${of(vehicle.touched)}, after ${durationText(vehicle.t_s)}.`);
  if (result.stopped !== null) dangers.push(`The stream would stop: ${result.stopped}.`);
  const facts = [
    arrivalText(result, arrival_s),
    battery === null ? '' : `battery ${fixed(100 * battery.p50, 0)} %`,
    fence === null || fence.touched > 0 ? '' : nearestText('geofence', fence),
    obstacle === null || obstacle.touched > 0 ? '' : nearestText(obstacle.name, obstacle),
    vehicle === null || vehicle.touched > 0 ? '' : nearestText(nameOf(vehicle.name), vehicle),
    ...result.limited.map((limit) => `limited: ${limit}`),
  ];
  return { dangers, facts: `${flights} simulated flights: ${facts.filter(Boolean).join('; ')}.`, assumed: result.assumed };
}

function arrivalText({ flights, arrived, horizon_s, landed, target_ned_m }: Futures, arrival_s: Futures['arrival_s']): string {
  if (landed === flights) return `on the ground within ${durationText(horizon_s)}`;
  if (target_ned_m === null) return `within ${durationText(horizon_s)}`;
  if (arrival_s === null || arrived < flights / 2) return `under way for more than ${durationText(horizon_s)}`;
  return `there in ${fixed(arrival_s.p5, 0)} to ${fixed(arrival_s.p95, 0)} s`;
}

/**
 * The corridor, the mean path with the edges of the corridor for the 3D view, and the places where a flight touches something; null:
 * the place of the vehicle's local frame is not known.
 */
export function futuresLayer(result: Futures): LayerContent | null {
  const { origin, corridor, clear } = result;
  if (origin === null) return null;
  const tone = clear ? 'target' : 'danger';
  const at = ([north_m = 0, east_m = 0, down_m = 0]: readonly number[]): LayerPosition => ({
    ...positionAt(origin, { north_m, east_m }),
    alt_amsl_m: origin.alt_amsl_m - down_m,
  });
  const path = corridor.position_ned_m;
  const shifted = (sign: number): LayerPosition[] =>
    path.map(([north = 0, east = 0, down = 0], i) => at([north, east, down - sign * (corridor.vertical_m[i] ?? 0)]));
  const line = (positions: readonly LayerPosition[], style: LayerLine['style']): LayerLine => ({ positions, tone, style });
  const things = [result.fence, result.obstacle, result.vehicle].filter((each): each is Nearest => each !== null && each.touched > 0);
  return {
    lines: [line(path.map(at), 'dashed'), line(shifted(1), 'dotted'), line(shifted(-1), 'dotted')],
    areas: [...corridorRings(origin, path, corridor.horizontal_m), endDisc(origin, path.at(-1) ?? [], corridor.horizontal_m.at(-1) ?? 0)].map((ring) => ({
      ring,
      tone,
    })),
    points: things.map(({ name, position_ned_m }) => ({ ...at(position_ned_m), id: name, mark: 'cross', tone: 'danger', text: '', selected: false })),
    ground: { lat_deg: origin.lat_deg, lon_deg: origin.lon_deg, alt_amsl_m: origin.alt_amsl_m },
  };
}

/** Where the vehicle may be at the end: around a hover there is no corridor along a path. */
function endDisc(origin: GeoPosition, [north_m = 0, east_m = 0]: readonly number[], radius_m: number): GeoPosition[] {
  return Array.from({ length: DISC_POINTS }, (_, i) => {
    const angle = (2 * Math.PI * i) / DISC_POINTS;
    return positionAt(origin, { north_m: north_m + radius_m * Math.cos(angle), east_m: east_m + radius_m * Math.sin(angle) });
  });
}
