/** A mission as a map layer and as list entries. Pure functions. */

import type { LayerLine, LayerContent, LayerPosition } from '../../../app/map-layers.svelte';
import { durationText } from '../../../ui/format';
import { positionAt, type GeoPosition } from '../../../vehicle/geo';
import { pointAdder, areaLayer, sketchLines, type Sketch } from '../document/layer';
import { midpoint } from '../document/edit';
import { homeEntry, areaEntries, type ListEntry } from '../document/list-entries';
import { nodesOf, stepPlaceOf, positionsOf, pointId, pointRefOf, roleNames, roleTone, stepId, type Mission, type StepNode } from './mission';
import { altitudeText, geoPointOf, type MissionFrame, type GeoPoint } from './positions';
import type { CompiledFlight, StepTime } from './mission';
import { detailOf, stepTitle } from './step-titles';

/** Above this number of points, midpoints are shown only beside the selection. */
const MAX_MIDPOINTS = 60;

/** Text on a point, such as "2b": number of the step and letter of the point; from the 27th point "2 27". */
export function pointLabel(node: StepNode, index: number, count: number): string {
  if (count === 1) return node.numberText;
  return node.numberText + (index < 26 ? String.fromCharCode(97 + index) : ` ${index + 1}`);
}

export function missionLayer(
  mission: Mission,
  selected: ReadonlySet<string>,
  sketch: Sketch | null,
  frame: MissionFrame,
  flight: CompiledFlight | null,
  isCurrent: boolean,
): LayerContent {
  const { points, areas, lines, solids } = areaLayer(mission, selected, sketch, frame.start.alt_amsl_m);
  const add = pointAdder(points, selected);
  const nodes = nodesOf(mission);
  const showsAllMidpoints = nodes.reduce((count, node) => count + (node.step.points?.length ?? 0), 0) <= MAX_MIDPOINTS;
  const selectedPlaces = new Set([...selected].map(stepPlaceOf));
  add('home', frame.start, 'home', 'text2');
  const drawnPaths = new Set<string>();
  for (const node of nodes) {
    // The points of a list of steps that is called twice are shown once.
    const pathKey = JSON.stringify(node.path);
    if (drawnPaths.has(pathKey)) continue;
    drawnPaths.add(pathKey);
    const positions = positionsOf(node);
    const count = node.step.points?.length ?? 0;
    if (showsAllMidpoints || selectedPlaces.has(node.place))
      for (let i = 1; i < count; i += 1) {
        const [a, b] = [node.step.points?.[i - 1], node.step.points?.[i]];
        if (a !== undefined && b !== undefined)
          add(
            `between:${i}:${node.place}`,
            midpoint(withAltitude(geoPointOf(a, frame), frame), withAltitude(geoPointOf(b, frame), frame)),
            'midpoint',
            'target',
          );
      }
    for (const { ref, position } of positions) {
      const isFlown = ref.field === 'points';
      const text = isFlown ? pointLabel(node, ref.index, count) : '';
      add(
        pointId(ref),
        withAltitude(geoPointOf(position, frame), frame),
        isFlown ? 'disc' : 'cross',
        isFlown ? 'target' : 'actual',
        text,
        altitudeText(position, frame),
      );
    }
  }
  lines.push(...(flight === null ? straightLines(nodes, frame) : flightLines(flight, roleNames(mission), frame, isCurrent)), ...sketchLines(sketch));
  const { lat_deg, lon_deg, alt_amsl_m } = frame.start;
  return { points, lines, areas, solids, ground: { lat_deg, lon_deg, alt_amsl_m } };
}

/** A point with its altitude AMSL. */
function withAltitude({ lat_deg, lon_deg, up_m }: GeoPoint, frame: MissionFrame): LayerPosition {
  return { lat_deg, lon_deg, alt_amsl_m: frame.start.alt_amsl_m + up_m };
}

/** Straight lines between the points, used until the server has compiled the path. */
function straightLines(nodes: readonly StepNode[], frame: MissionFrame): LayerLine[] {
  const positions = nodes.flatMap((node) => (node.step.points ?? []).map((point) => withAltitude(geoPointOf(point, frame), frame)));
  return positions.length === 0 ? [] : [{ positions: [frame.start, ...positions], tone: 'target', style: 'dotted' }];
}

/** The compiled path. Alternative branches and outdated paths are dotted. */
function flightLines(flight: CompiledFlight, roles: readonly string[], frame: MissionFrame, isCurrent: boolean): LayerLine[] {
  const lines: { main: boolean; role: string | null; positions: LayerPosition[] }[] = [];
  for (const { main, role, points } of flight.legs) {
    const positions = points.map(([, north_m, east_m, down_m]): LayerPosition => ({
      ...positionAt(frame.origin, { north_m, east_m }),
      alt_amsl_m: frame.origin.alt_amsl_m - down_m,
    }));
    const previous = lines.at(-1);
    if (previous !== undefined && previous.main === main && previous.role === role && isSamePosition(previous.positions.at(-1), positions[0]))
      previous.positions.push(...positions.slice(1));
    else lines.push({ main, role, positions });
  }
  return lines
    .filter(({ positions }) => positions.length > 1)
    .map(({ main, role, positions }) => ({ positions, tone: role === null ? 'target' : roleTone(roles, role), style: main && isCurrent ? 'solid' : 'dotted' }));
}

function isSamePosition(a: GeoPosition | undefined, b: GeoPosition | undefined): boolean {
  return a !== undefined && b !== undefined && Math.abs(a.lat_deg - b.lat_deg) < 1e-7 && Math.abs(a.lon_deg - b.lon_deg) < 1e-7;
}

/** Parses the id of a leg's midpoint. @returns the step, and the index that a new point gets; null: the id of another part. */
export function parseLegMidpointId(id: string): { index: number; place: string } | null {
  const match = /^between:(\d+):(.*)$/s.exec(id);
  return match === null ? null : { index: Number(match[1]), place: match[2] ?? '' };
}

/** The list entries of a mission. The duration of a step contains the durations of its nested steps. */
export function missionEntries(mission: Mission, times: readonly StepTime[]): ListEntry[] {
  const timeOfStep = new Map(times.map((time) => [time.place, time]));
  const duration_s = (node: StepNode, nestedNodes: readonly StepNode[]): number | null => {
    const times_s = [node, ...nestedNodes].flatMap(({ place }) => timeOfStep.get(place)?.duration_s ?? []);
    return times_s.length === 0 ? null : times_s.reduce((sum, time_s) => sum + time_s, 0);
  };
  const nodes = nodesOf(mission);
  return [
    ...homeEntry(mission.home ?? null),
    ...nodes.map((node, index): ListEntry => {
      const endIndex = nodes.findIndex((other, i) => i > index && other.depth <= node.depth);
      const stepDuration_s = duration_s(node, nodes.slice(index + 1, endIndex < 0 ? nodes.length : endIndex));
      const photos = timeOfStep.get(node.place)?.photos ?? 0;
      const estimateText = [
        stepDuration_s === null || stepDuration_s < 0.5 ? '' : durationText(stepDuration_s),
        photos > 0 ? `${photos} ${photos === 1 ? 'photo' : 'photos'}` : '',
      ]
        .filter(Boolean)
        .join('\n');
      return {
        ids: [stepId(node.place)],
        row: null,
        stepPlace: node.place,
        symbol: node.numberText,
        icon: null,
        tone: 'target',
        title: stepTitle(node.step),
        detail: detailOf(node.step),
        depth: node.depth,
        listHeading: node.listHeading,
        estimateText,
      };
    }),
    ...areaEntries(mission),
  ];
}

/** Whether one of the points of this step is selected. */
export function hasSelectedPoint(entry: ListEntry, selected: ReadonlySet<string>): boolean {
  return entry.stepPlace !== undefined && [...selected].some((id) => pointRefOf(id)?.place === entry.stepPlace);
}
