/** A mission as a map layer and as list entries. Pure. */

import type { LayerLine, LayerPicture, LayerPosition } from '../../../app/map-layers.svelte';
import { duration } from '../../../ui/format';
import { positionAt, type GeoPosition } from '../../../vehicle/geo';
import { adder, fencePicture, sketchLines, type Sketch } from '../document/layer';
import { midpoint } from '../document/edit';
import { homeEntry, sharedEntries, type TreeEntry } from '../document/list-entries';
import { nodesOf, stepNameOf, positionsOf, pointId, pointOf, stepId, type Mission, type StepNode } from './mission';
import { geoPointOf, heightText, type Frame, type GeoPoint } from './positions';
import type { Flight, StepTime } from './compiled-path';
import { detailOf, stepTitle } from './step-titles';

/** Above this number of points, midpoints are shown only beside the selection. */
const MAX_MIDPOINTS = 60;

/** "2b": the step's number and the point's letter, from the 27th point on its number. */
export function pointMark(node: StepNode, index: number, count: number): string {
  if (count === 1) return node.mark;
  return node.mark + (index < 26 ? String.fromCharCode(97 + index) : ` ${index + 1}`);
}

export function picture(
  mission: Mission,
  selected: ReadonlySet<string>,
  sketch: Sketch | null,
  frame: Frame,
  flight: Flight | null,
  isCurrent: boolean,
): LayerPicture {
  const { points, areas, lines, solids } = fencePicture(mission, selected, sketch, frame.start.alt_amsl_m);
  const add = adder(points, selected);
  const nodes = nodesOf(mission);
  const showsAllMidpoints = nodes.reduce((count, node) => count + (node.step.points?.length ?? 0), 0) <= MAX_MIDPOINTS;
  const chosen = new Set([...selected].map(stepNameOf));
  add('home', frame.start, 'home', 'text2');
  const drawn = new Set<string>();
  for (const node of nodes) {
    // A mission that is called twice shows its points once.
    const key = JSON.stringify(node.path);
    if (drawn.has(key)) continue;
    drawn.add(key);
    const positions = positionsOf(node);
    const count = node.step.points?.length ?? 0;
    if (showsAllMidpoints || chosen.has(node.place))
      for (let i = 1; i < count; i += 1) {
        const [a, b] = [node.step.points?.[i - 1], node.step.points?.[i]];
        if (a !== undefined && b !== undefined)
          add(`between:${i}:${node.place}`, midpoint(inSpace(geoPointOf(a, frame), frame), inSpace(geoPointOf(b, frame), frame)), 'middle', 'target');
      }
    for (const { ref, at } of positions) {
      const flown = ref.field === 'points';
      const text = flown ? pointMark(node, ref.index, count) : '';
      add(pointId(ref), inSpace(geoPointOf(at, frame), frame), flown ? 'disc' : 'cross', flown ? 'target' : 'actual', text, heightText(at, frame));
    }
  }
  lines.push(...(flight === null ? straight(nodes, frame) : flightLines(flight, frame, isCurrent)), ...sketchLines(sketch));
  const { lat_deg, lon_deg, alt_amsl_m } = frame.start;
  return { points, lines, areas, solids, ground: { lat_deg, lon_deg, alt_amsl_m } };
}

/** A point with its altitude for the 3D view. */
function inSpace({ lat_deg, lon_deg, up_m }: GeoPoint, frame: Frame): LayerPosition {
  return { lat_deg, lon_deg, alt_amsl_m: frame.start.alt_amsl_m + up_m };
}

/** Straight lines between the points, used until the server has compiled the path. */
function straight(nodes: readonly StepNode[], frame: Frame): LayerLine[] {
  const positions = nodes.flatMap((node) => (node.step.points ?? []).map((point) => inSpace(geoPointOf(point, frame), frame)));
  return positions.length === 0 ? [] : [{ positions: [frame.start, ...positions], tone: 'target', style: 'dotted' }];
}

/** The compiled path. Alternative branches and outdated paths are dotted. */
function flightLines(flight: Flight, frame: Frame, isCurrent: boolean): LayerLine[] {
  const found: { main: boolean; positions: LayerPosition[] }[] = [];
  for (const { main, points } of flight.legs) {
    const positions = points.map(([, north_m, east_m, down_m]): LayerPosition => ({
      ...positionAt(frame.origin, { north_m, east_m }),
      alt_amsl_m: frame.origin.alt_amsl_m - down_m,
    }));
    const before = found.at(-1);
    if (before !== undefined && before.main === main && same(before.positions.at(-1), positions[0])) before.positions.push(...positions.slice(1));
    else found.push({ main, positions });
  }
  return found
    .filter(({ positions }) => positions.length > 1)
    .map(({ main, positions }) => ({ positions, tone: 'target', style: main && isCurrent ? 'solid' : 'dotted' }));
}

function same(a: GeoPosition | undefined, b: GeoPosition | undefined): boolean {
  return a !== undefined && b !== undefined && Math.abs(a.lat_deg - b.lat_deg) < 1e-7 && Math.abs(a.lon_deg - b.lon_deg) < 1e-7;
}

/** Parses the id of a leg's midpoint: the step, and the index of the point before which it inserts. */
export function betweenOf(id: string): { index: number; place: string } | null {
  const match = /^between:(\d+):(.*)$/s.exec(id);
  return match === null ? null : { index: Number(match[1]), place: match[2] ?? '' };
}

/** The steps with their durations; a step with nested steps has the sum of theirs. */
export function treeOf(mission: Mission, times: readonly StepTime[]): TreeEntry[] {
  const timeOfStep = new Map(times.map((time) => [time.place, time]));
  const seconds = (node: StepNode, below: readonly StepNode[]): number | null => {
    const own = timeOfStep.get(node.place);
    const inner = below.flatMap((one) => timeOfStep.get(one.place)?.duration_s ?? []);
    return own === undefined && inner.length === 0 ? null : (own?.duration_s ?? 0) + inner.reduce((sum, one) => sum + one, 0);
  };
  const nodes = nodesOf(mission);
  return [
    ...homeEntry(mission.home ?? null),
    ...nodes.map((node, index): TreeEntry => {
      const end = nodes.findIndex((one, i) => i > index && one.depth <= node.depth);
      const time_s = seconds(node, nodes.slice(index + 1, end < 0 ? nodes.length : end));
      const photos = timeOfStep.get(node.place)?.photos ?? 0;
      const side = [time_s === null || time_s < 0.5 ? '' : duration(time_s), photos > 0 ? `${photos} ${photos === 1 ? 'photo' : 'photos'}` : '']
        .filter(Boolean)
        .join('\n');
      return {
        ids: [stepId(node.place)],
        row: null,
        step: node.place,
        mark: node.mark,
        icon: null,
        tone: 'target',
        title: stepTitle(node.step),
        detail: detailOf(node.step),
        depth: node.depth,
        heading: node.heading,
        side,
      };
    }),
    ...sharedEntries(mission),
  ];
}

/** Whether a list entry is selected: the step itself or one of its points. */
export function isChosen(entry: TreeEntry, selected: ReadonlySet<string>): boolean {
  return entry.step !== undefined && [...selected].some((id) => pointOf(id)?.place === entry.step);
}
