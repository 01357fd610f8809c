/** A survey of a drawn area, in the API's format. */

import type { GeoPosition } from '../../vehicle/geo';
import type { Pattern } from './api';

/** A common 20-megapixel camera with a one-inch sensor, and overlaps that photogrammetry programs recommend. */
export const SURVEY = {
  height_m: 40,
  front_percent: 75,
  side_percent: 65,
  focal_length_mm: 8.8,
  sensor_width_mm: 13.2,
  sensor_height_mm: 8.8,
  turnaround_m: 0,
  follows_ground: false,
};
/** Largest deviation of the lines of a survey from their height above ground [m]. */
export const GROUND_TOLERANCE_M = 5;
const IMAGE_WIDTH_PX = 5472;

/** If the survey does not follow the terrain, the ground is assumed to be level with home. */
export function surveyOf(outer: readonly GeoPosition[], values: typeof SURVEY): Pattern {
  const { height_m, sensor_width_mm, sensor_height_mm, focal_length_mm } = values;
  const image_height_px = Math.round((IMAGE_WIDTH_PX * sensor_height_mm) / sensor_width_mm);
  const camera = { sensor_width_mm, sensor_height_mm, focal_length_mm, image_width_px: IMAGE_WIDTH_PX, image_height_px };
  return {
    kind: 'survey',
    outer,
    altitude: { value_m: height_m, reference: values.follows_ground ? 'terrain' : 'home' },
    coverage: { camera, distance_m: height_m, front_overlap: values.front_percent / 100, side_overlap: values.side_percent / 100 },
    turnaround_m: values.turnaround_m,
  };
}
