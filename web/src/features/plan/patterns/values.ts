/** The settings of patterns: their rows in the form, and their conversion to the API's format. Pure functions. */

import type { GeoPosition } from '../../../vehicle/geo';
import type { Altitude, AltitudeReference, Pattern } from '../document/document';
import { REFERENCE_CHOICES } from '../document/items';
import { boundsOf, inPercent, quantityOf, type FieldValue, type ShownField } from '../../../vehicle/fields';
import type { PatternKind, Rings } from './shape';

/** The values of the settings of all patterns. Overlaps are in per cent here, and fractions in the API. */
export interface PatternValues {
  readonly altitude_m: number;
  readonly reference: AltitudeReference;
  /** Distance from the camera to the ground; null: equal to the altitude. */
  readonly distance_m: number | null;
  /** Null: no camera, the distances between lines and photos are entered. */
  readonly has_camera: boolean;
  readonly spacing_m: number;
  /** Distance between photos; 0: no photos. */
  readonly trigger_m: number;
  /** Overlap of photos along a line. */
  readonly front_percent: number;
  /** Overlap of photos of neighbouring lines. */
  readonly side_percent: number;
  readonly orientation: 'landscape' | 'portrait';
  readonly sensor_width_mm: number;
  readonly sensor_height_mm: number;
  readonly focal_length_mm: number;
  readonly image_width_px: number;
  readonly image_height_px: number;
  /** Null: the direction with the shortest path. */
  readonly heading_deg: number | null;
  readonly turnaround_m: number;
  readonly crosshatch: boolean;
  readonly speed_m_s: number | null;
  readonly width_m: number;
  /** Distance of a perimeter from the edge of the area. */
  readonly offset_m: number;
  readonly rounds: number;
  readonly radius_m: number;
  readonly direction: 'clockwise' | 'counterclockwise';
  readonly start_deg: number;
  readonly looks_at_center: boolean;
  /** Altitude that the camera looks at. */
  readonly look_at_m: number;
  /** Altitude of the base of the structure. */
  readonly base_m: number;
  readonly height_m: number;
  /** Height of the lowest round above the base. */
  readonly lowest_m: number;
  /** Distance from the sides of the structure. */
  readonly structure_distance_m: number;
  /** Order of the rounds. */
  readonly order: 'up' | 'down';
  readonly gimbal_pitch_deg: number;
  /** Null: as many as cover the height. */
  readonly layers: number | null;
  /** Altitude at which the vehicle comes and leaves; null: the rounds begin and end the pattern. */
  readonly entrance_m: number | null;
}
export type ValueName = keyof PatternValues;
export type RowName = ValueName | 'camera';
/** The part of the form to which a problem belongs; `shape`: the drawn shape; null: the whole form. */
export type ProblemPlace = ValueName | 'shape' | null;

type CameraValues = Pick<PatternValues, 'sensor_width_mm' | 'sensor_height_mm' | 'focal_length_mm' | 'image_width_px' | 'image_height_px'>;
const cameraValues = (
  sensor_width_mm: number,
  sensor_height_mm: number,
  focal_length_mm: number,
  image_width_px: number,
  image_height_px: number,
): CameraValues => ({
  sensor_width_mm,
  sensor_height_mm,
  focal_length_mm,
  image_width_px,
  image_height_px,
});
/** Common sensors and lenses. */
const CAMERAS: Readonly<Record<string, CameraValues>> = {
  '1-inch, 20 MP, 8.8 mm': cameraValues(13.2, 8.8, 8.8, 5472, 3648),
  '4/3-inch, 20 MP, 12.3 mm': cameraValues(17.3, 13, 12.3, 5280, 3956),
  'APS-C, 24 MP, 16 mm': cameraValues(23.5, 15.6, 16, 6000, 4000),
  'Full frame, 42 MP, 35 mm': cameraValues(35.9, 24, 35, 7952, 5304),
  '1/2.3-inch, 12 MP, 4.7 mm': cameraValues(6.17, 4.55, 4.7, 4000, 3000),
};
const CAMERA_FIELDS = Object.keys(cameraValues(0, 0, 0, 0, 0)) as (keyof CameraValues)[];

/** The overlaps are those that photogrammetry programs recommend. */
export const DEFAULT_VALUES: PatternValues = {
  altitude_m: 40,
  reference: 'home',
  distance_m: null,
  has_camera: true,
  spacing_m: 20,
  trigger_m: 10,
  front_percent: 75,
  side_percent: 65,
  orientation: 'landscape',
  ...cameraValues(13.2, 8.8, 8.8, 5472, 3648),
  heading_deg: null,
  turnaround_m: 0,
  crosshatch: false,
  speed_m_s: null,
  width_m: 50,
  offset_m: 0,
  rounds: 1,
  radius_m: 30,
  direction: 'clockwise',
  start_deg: 0,
  looks_at_center: true,
  look_at_m: 0,
  base_m: 0,
  height_m: 20,
  lowest_m: 3,
  structure_distance_m: 10,
  order: 'up',
  gimbal_pitch_deg: 0,
  layers: null,
  entrance_m: null,
};

type FieldSpec = Omit<ShownField, 'value'>;
/** A number row. @param model the API's model with the field, which has the bounds. @param field its name there, if it is another one. */
const numberSpec = (label: string, name: ValueName, model: string, details: Partial<FieldSpec> = {}, field: string = name): FieldSpec => {
  const limits = boundsOf(model, field);
  const { scale: _, ...quantity } = quantityOf(name, name.endsWith('_percent') ? inPercent(limits) : limits);
  return { label, type: 'number', ...quantity, ...details };
};
const choiceSpec = (label: string, options: readonly { value: string; text: string }[]): FieldSpec => ({ label, type: 'choice', options });
const choicesOf = (texts: Readonly<Record<string, string>>) => Object.entries(texts).map(([value, text]) => ({ value, text }));

const ANGLE = { min: -360, max: 360 };
const WHOLE = { decimals: 0 };
const FIELD_SPECS: Readonly<Record<ValueName, FieldSpec>> = {
  altitude_m: numberSpec('Altitude', 'altitude_m', 'Altitude', {}, 'value_m'),
  reference: choiceSpec('Reference', REFERENCE_CHOICES),
  distance_m: numberSpec('Distance from camera to ground', 'distance_m', 'PhotoCoverage', { placeholder: 'same as altitude' }),
  has_camera: { label: 'Camera', type: 'switch' },
  spacing_m: numberSpec('Distance between lines', 'spacing_m', 'PhotoCoverage'),
  trigger_m: numberSpec('Distance between photos (0: none)', 'trigger_m', 'PhotoCoverage'),
  front_percent: numberSpec('Front overlap', 'front_percent', 'PhotoCoverage', {}, 'front_overlap'),
  side_percent: numberSpec('Side overlap', 'side_percent', 'PhotoCoverage', {}, 'side_overlap'),
  orientation: choiceSpec('Camera orientation', choicesOf({ landscape: 'landscape', portrait: 'portrait' })),
  sensor_width_mm: numberSpec('Sensor width', 'sensor_width_mm', 'CameraModel'),
  sensor_height_mm: numberSpec('Sensor height', 'sensor_height_mm', 'CameraModel'),
  focal_length_mm: numberSpec('Focal length', 'focal_length_mm', 'CameraModel'),
  image_width_px: numberSpec('Photo width', 'image_width_px', 'CameraModel', WHOLE),
  image_height_px: numberSpec('Photo height', 'image_height_px', 'CameraModel', WHOLE),
  heading_deg: numberSpec('Heading of the lines', 'heading_deg', 'kind_survey', { ...ANGLE, placeholder: 'shortest path' }),
  turnaround_m: numberSpec('Turnaround distance', 'turnaround_m', 'kind_survey'),
  crosshatch: { label: 'Second set of lines at right angles', type: 'switch' },
  speed_m_s: numberSpec('Speed', 'speed_m_s', 'kind_survey', { placeholder: 'default' }),
  width_m: numberSpec('Width', 'width_m', 'kind_corridor'),
  offset_m: numberSpec('Distance outside the edge (negative: inside)', 'offset_m', 'kind_perimeter'),
  rounds: numberSpec('Rounds', 'rounds', 'kind_orbit', WHOLE),
  radius_m: numberSpec('Radius', 'radius_m', 'kind_orbit'),
  direction: choiceSpec('Direction', choicesOf({ clockwise: 'clockwise', counterclockwise: 'counter-clockwise' })),
  start_deg: numberSpec('Start bearing', 'start_deg', 'kind_orbit', ANGLE),
  looks_at_center: { label: 'Camera looks at the centre', type: 'switch' },
  look_at_m: numberSpec('Camera target altitude (reference as above)', 'look_at_m', 'Altitude', {}, 'value_m'),
  base_m: numberSpec('Altitude of the base', 'base_m', 'Altitude', {}, 'value_m'),
  height_m: numberSpec('Height of the structure', 'height_m', 'kind_structure'),
  lowest_m: numberSpec('Lowest round above base', 'lowest_m', 'kind_structure'),
  structure_distance_m: numberSpec('Distance to the sides', 'structure_distance_m', 'PhotoCoverage', {}, 'distance_m'),
  layers: numberSpec('Number of rounds', 'layers', 'kind_structure', { ...WHOLE, placeholder: 'as needed' }),
  entrance_m: numberSpec('Altitude of entry and exit', 'entrance_m', 'Altitude', { placeholder: 'none' }, 'value_m'),
  order: choiceSpec('Order', choicesOf({ up: 'from the bottom', down: 'from the top' })),
  gimbal_pitch_deg: numberSpec('Gimbal pitch', 'gimbal_pitch_deg', 'kind_structure', { min: -90, max: 90 }),
};
const INTEGER_FIELDS: ReadonlySet<ValueName> = new Set(['rounds', 'layers', 'image_width_px', 'image_height_px']);

/** Rows that a camera's data belong to; without a camera, the distances are entered. */
const CAMERA_ROWS: readonly RowName[] = ['orientation', 'front_percent', 'side_percent', ...CAMERA_FIELDS];
const NO_CAMERA = 'none: distances by hand';

interface SectionSpec {
  readonly title: string;
  readonly rows: readonly RowName[];
  /** Whether the section is closed initially. */
  readonly folded?: boolean;
}
const CAMERA_DATA_SECTION: SectionSpec = { title: 'Camera data', rows: CAMERA_FIELDS, folded: true };
const photoSection = (...rows: RowName[]): SectionSpec => ({
  title: 'Photos',
  rows: ['camera', 'spacing_m', 'trigger_m', ...rows, 'front_percent', 'side_percent'],
});
const ALTITUDE_ROWS: readonly RowName[] = ['altitude_m', 'reference'];
const SECTIONS: Readonly<Record<PatternKind, readonly SectionSpec[]>> = {
  survey: [
    { title: 'Altitude', rows: [...ALTITUDE_ROWS, 'distance_m'] },
    photoSection('orientation'),
    { title: 'Lines', rows: ['heading_deg', 'turnaround_m', 'speed_m_s', 'crosshatch'] },
    CAMERA_DATA_SECTION,
  ],
  corridor: [
    { title: 'Corridor', rows: ['width_m', 'turnaround_m'] },
    { title: 'Altitude', rows: [...ALTITUDE_ROWS, 'distance_m'] },
    photoSection('orientation'),
    CAMERA_DATA_SECTION,
  ],
  perimeter: [{ title: 'Path', rows: [...ALTITUDE_ROWS, 'offset_m', 'rounds'] }],
  orbit: [
    { title: 'Path', rows: ['radius_m', ...ALTITUDE_ROWS, 'rounds', 'direction', 'start_deg'] },
    { title: 'Camera', rows: ['looks_at_center', 'look_at_m'] },
  ],
  structure: [
    { title: 'Structure', rows: ['base_m', 'reference', 'height_m'] },
    { title: 'Rounds', rows: ['structure_distance_m', 'lowest_m', 'layers', 'order', 'gimbal_pitch_deg', 'entrance_m'] },
    photoSection('orientation'),
    CAMERA_DATA_SECTION,
  ],
};

export interface Row {
  readonly name: RowName;
  readonly field: ShownField;
}
export interface Section extends Omit<SectionSpec, 'rows'> {
  readonly rows: readonly Row[];
}

/** The form of a pattern. */
export function sectionsOf(kind: PatternKind, values: PatternValues): Section[] {
  const hidden: ReadonlySet<RowName> = new Set([
    ...(values.looks_at_center ? [] : (['look_at_m'] as const)),
    ...(values.has_camera ? (['spacing_m', 'trigger_m'] as const) : CAMERA_ROWS),
  ]);
  return SECTIONS[kind].map((section) => ({
    ...section,
    rows: section.rows
      .filter((name) => !hidden.has(name))
      .map((name): Row => ({ name, field: name === 'camera' ? cameraField(values) : { ...FIELD_SPECS[name], value: values[name] } })),
  }));
}

function cameraField(values: PatternValues): ShownField {
  const cameraName = Object.entries(CAMERAS).find(([, data]) => CAMERA_FIELDS.every((name) => data[name] === values[name]))?.[0];
  const names = [...Object.keys(CAMERAS), ...(cameraName === undefined ? ['other'] : []), NO_CAMERA];
  return {
    label: 'Camera',
    type: 'choice',
    value: values.has_camera ? (cameraName ?? 'other') : NO_CAMERA,
    options: names.map((value) => ({ value, text: value })),
  };
}

/** The values after a row was edited. */
export function withRow(values: PatternValues, name: RowName, value: FieldValue): PatternValues {
  if (name === 'camera') return { ...values, has_camera: value !== NO_CAMERA, ...CAMERAS[String(value)] };
  return { ...values, [name]: INTEGER_FIELDS.has(name) && value !== null ? Math.round(Number(value)) : value };
}

/** The values with the camera that was stored in the browser; an invalid camera is ignored. */
export function withCamera(values: PatternValues, stored: unknown): PatternValues {
  const camera = (stored ?? {}) as Readonly<Record<string, unknown>>;
  const isValid = CAMERA_FIELDS.every((name) => typeof camera[name] === 'number' && Number.isFinite(camera[name]) && camera[name] > 0);
  return isValid ? { ...values, ...Object.fromEntries(CAMERA_FIELDS.map((name) => [name, camera[name]])) } : values;
}

export function cameraOf(values: PatternValues): CameraValues {
  return Object.fromEntries(CAMERA_FIELDS.map((name) => [name, values[name]])) as unknown as CameraValues;
}

/** A problem of one field or of the whole form. */
export interface FieldProblem {
  readonly place: ProblemPlace;
  readonly text: string;
}
export type PatternRequest = { readonly ok: true; readonly pattern: Pattern } | { readonly ok: false; readonly problem: FieldProblem };

/** The pattern in the API's format. */
export function requestOf(kind: PatternKind, rings: Rings, values: PatternValues): PatternRequest {
  const [firstRing = [], ...holes] = rings.filter((ring, i) => i === 0 || ring.length > 0).map((ring) => [...ring]);
  const altitude: Altitude = { value_m: values.altitude_m, reference: values.reference };
  const photographsGround = kind === 'survey' || kind === 'corridor';
  if (photographsGround && values.reference === 'amsl' && values.distance_m === null) {
    const text = 'With an altitude AMSL, the distance to the ground is not known. Enter “Distance from camera to ground”.';
    return { ok: false, problem: { place: 'distance_m', text } };
  }
  const coverage = coverageOf(values, kind === 'structure' ? values.structure_distance_m : (values.distance_m ?? values.altitude_m));
  if (photographsGround && coverage.distance_m <= 0)
    return { ok: false, problem: { place: 'altitude_m', text: 'Enter an altitude above 0 m: the camera looks down at the ground.' } };
  return { ok: true, pattern: patternOf(kind, firstRing, holes, values, altitude, coverage) };
}

type Coverage = Extract<Pattern, { kind: 'survey' }>['coverage'];
function coverageOf(values: PatternValues, distance_m: number): Coverage {
  const { spacing_m, trigger_m, has_camera } = values;
  const overlaps = { front_overlap: DEFAULT_VALUES.front_percent / 100, side_overlap: DEFAULT_VALUES.side_percent / 100 };
  if (!has_camera) return { camera: null, distance_m, spacing_m, trigger_m, ...overlaps };
  return {
    spacing_m: null,
    trigger_m: null,
    camera: { ...cameraOf(values), landscape: values.orientation === 'landscape' },
    distance_m,
    front_overlap: values.front_percent / 100,
    side_overlap: values.side_percent / 100,
  };
}

function patternOf(
  kind: PatternKind,
  firstRing: GeoPosition[],
  holes: GeoPosition[][],
  values: PatternValues,
  altitude: Altitude,
  coverage: Coverage,
): Pattern {
  const { turnaround_m, rounds } = values;
  switch (kind) {
    case 'survey': {
      const { heading_deg, crosshatch, speed_m_s } = values;
      return { kind, outer: firstRing, holes, coverage, altitude, heading_deg, turnaround_m, crosshatch, speed_m_s };
    }
    case 'corridor':
      return { kind, points: firstRing, width_m: values.width_m, coverage, altitude, turnaround_m };
    case 'perimeter':
      return { kind, outer: firstRing, offset_m: values.offset_m, altitude, rounds };
    case 'orbit': {
      const look_at = values.looks_at_center ? { value_m: values.look_at_m, reference: values.reference } : null;
      const { radius_m, start_deg } = values;
      const clockwise = values.direction === 'clockwise';
      return { kind, center: firstRing[0] ?? { lat_deg: 0, lon_deg: 0 }, radius_m, altitude, look_at, rounds, clockwise, start_deg };
    }
    case 'structure': {
      const base = { value_m: values.base_m, reference: values.reference };
      const { height_m, lowest_m, gimbal_pitch_deg, layers, entrance_m } = values;
      const entrance = entrance_m === null ? null : { value_m: entrance_m, reference: values.reference };
      return { kind, outline: firstRing, coverage, base, height_m, lowest_m, from_top: values.order === 'down', gimbal_pitch_deg, layers, entrance };
    }
  }
}

/** The values of the form for a pattern; values that the pattern does not have stay. */
export function valuesOf(pattern: Pattern, values: PatternValues): PatternValues {
  switch (pattern.kind) {
    case 'survey':
    case 'corridor': {
      const { altitude, coverage, turnaround_m = 0 } = pattern;
      const isSame = coverage.distance_m === altitude.value_m && altitude.reference !== 'amsl';
      const own =
        pattern.kind === 'corridor'
          ? { width_m: pattern.width_m }
          : { heading_deg: pattern.heading_deg ?? null, crosshatch: pattern.crosshatch ?? false, speed_m_s: pattern.speed_m_s ?? null };
      return { ...withCoverage(values, coverage), ...altitudeValues(altitude), turnaround_m, ...own, distance_m: isSame ? null : coverage.distance_m };
    }
    case 'perimeter':
      return { ...values, ...altitudeValues(pattern.altitude), offset_m: pattern.offset_m ?? 0, rounds: pattern.rounds ?? 1 };
    case 'orbit': {
      const { radius_m, rounds = 1, start_deg = 0, look_at } = pattern;
      const camera = { looks_at_center: look_at != null, look_at_m: look_at?.value_m ?? values.look_at_m };
      const direction = (pattern.clockwise ?? true) ? 'clockwise' : 'counterclockwise';
      return { ...values, ...altitudeValues(pattern.altitude), radius_m, rounds, start_deg, direction, ...camera };
    }
    case 'structure': {
      const { base, height_m, lowest_m = 3, gimbal_pitch_deg = 0, layers = null, entrance, coverage } = pattern;
      const rounds = { base_m: base.value_m, reference: base.reference, height_m, lowest_m, gimbal_pitch_deg, layers, entrance_m: entrance?.value_m ?? null };
      const order = (pattern.from_top ?? false) ? 'down' : 'up';
      return { ...withCoverage(values, coverage), ...rounds, order, structure_distance_m: coverage.distance_m };
    }
  }
}

function altitudeValues(altitude: Altitude): Pick<PatternValues, 'altitude_m' | 'reference'> {
  return { altitude_m: altitude.value_m, reference: altitude.reference };
}

function withCoverage(values: PatternValues, { camera, spacing_m, trigger_m, front_overlap, side_overlap }: Coverage): PatternValues {
  if (camera == null) return { ...values, has_camera: false, spacing_m: spacing_m ?? values.spacing_m, trigger_m: trigger_m ?? 0 };
  const { landscape = true, ...data } = camera;
  const percent = (share: number): number => Number((share * 100).toFixed(6));
  const overlaps = { front_percent: percent(front_overlap ?? 0.75), side_percent: percent(side_overlap ?? 0.65) };
  return { ...values, has_camera: true, ...data, ...overlaps, orientation: landscape ? 'landscape' : 'portrait' };
}

/** Prefixes of API field paths, each with the row beside which a problem is shown. The first match applies. */
const API_FIELDS: readonly (readonly [string, ProblemPlace])[] = [
  ['coverage.front_overlap', 'front_percent'],
  ['coverage.side_overlap', 'side_percent'],
  ['coverage.distance_m', 'distance_m'],
  ['coverage', 'side_percent'],
  ['altitude', 'altitude_m'],
  ['look_at', 'look_at_m'],
  ['base', 'base_m'],
  ['entrance', 'entrance_m'],
  ['outer', 'shape'],
  ['holes', 'shape'],
  ['points', 'shape'],
  ['outline', 'shape'],
  ['center', 'shape'],
  ['clockwise', 'direction'],
  ['from_top', 'order'],
];

/** The row beside which a problem of this API field is shown; null: the problem belongs to the whole form. */
export function problemPlaceOf(kind: PatternKind, field: string | null): ProblemPlace {
  if (field === null) return null;
  const lastName = field.split('.').at(-1) ?? '';
  if (field.startsWith('coverage.camera.') && lastName in FIELD_SPECS) return lastName as ValueName;
  const place = API_FIELDS.find(([prefix]) => field.startsWith(prefix))?.[1] ?? (field in FIELD_SPECS ? (field as ValueName) : null);
  return place === 'distance_m' && kind === 'structure' ? 'structure_distance_m' : place;
}
